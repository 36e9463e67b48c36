"""The SLAM system: front end, back end, loop closing, finish, and the pipeline that joins them."""

"""ICE matching: relative poses from Intersections, Corners and Ends of walls.

A scan is cut into segments, whose ends and crossings are its features. Pairs of a new and a reference feature give
hypotheses, the fitness ranks them, the leading ones are polished on points, and the scores around the winner give
its covariance. `matcher.IceMatcher` puts the stages together; each can be called on its own.

The kernels work on rows of plain arrays; `segments.Segments` and `features.Features` name their columns.
"""

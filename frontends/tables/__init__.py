"""Tables of scans (CSV, Parquet, NPZ): how anybody's recording comes in, in one layout (docs/formats.md)."""

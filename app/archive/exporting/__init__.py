"""Export of runs for other programs: tables, MATLAB, Parquet, workbooks, Universal Files."""

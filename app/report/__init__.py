"""The report of a specimen: what stands in it is computed once (`report`), and set twice, as PDF and as HTML."""

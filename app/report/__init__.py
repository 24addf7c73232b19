"""Report of a specimen: content computed once, written as PDF and HTML."""

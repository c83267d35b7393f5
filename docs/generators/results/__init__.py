"""Pages of measured results, made from committed JSON."""

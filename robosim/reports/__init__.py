"""Reports that a laboratory decides by: error against run time, stability, and what a scene needs."""

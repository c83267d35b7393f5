"""Reports that a laboratory decides by: error against run time, stability, speed, and what a scene needs."""

"""``run.rrd`` and the live stream for the Rerun viewer."""

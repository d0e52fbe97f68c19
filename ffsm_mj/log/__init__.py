"""Recording and reading of runs: sinks for memory, MCAP and Rerun behind one recorder, the MCAP reader, run folders."""

"""Where a run goes while it runs: sinks for memory, MCAP and Rerun behind one recorder, and the reader of the MCAP."""

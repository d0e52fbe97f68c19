"""Recording and reading of runs: sinks for memory, MCAP and Rerun behind one recorder, the MCAP reader, run folders."""

import ffsm_mj.contact_models.registry  # noqa: F401 (who writes or reads a log needs the kinds of records that it registers)

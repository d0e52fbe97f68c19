"""Seeded mutations of scenarios, models, logs and campaigns, and the answers that the threat model allows.

The threat model is a section of ``docs/user-guide.md``. Series by its classes of input:

- trusted, possibly wrong: ``test_series`` (scenarios, models, overrides, paths), ``test_captures``, ``test_friction``, ``test_numbers``;
- possibly hostile: ``test_strangers`` (logs, run folders, campaign folders, robot files), ``test_logs``, and the mutated logs of the other series.

No command may print a traceback, run without end, write anything but the requested output or print a control character; a fault
is one line with its file. A plain run of pytest takes a share of each series, ``--long`` all of it.
"""

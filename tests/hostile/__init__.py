"""Seeded mutations of scenarios, models, logs and campaigns, and the answers that the threat model allows.

The threat model is ``docs/threat-model.md``. Series by its classes of input:

- trusted, possibly wrong: scenarios, models, overrides and paths, those of friction and of grasps in series of their own;
- possibly hostile: logs, run and campaign folders, robot files of the series of strangers, and mutated logs of all series.

No command may print a traceback, run without end, write anything but the requested output or print a control character; a
fault is one line with its file. A plain run of pytest takes a share of each series, ``--long`` all of it.
"""

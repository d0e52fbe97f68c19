"""Implementation of ``ffsm check`` and ``ffsm schema``: validation of input files, and their schemas."""

from __future__ import annotations

import argparse
import json

from ffsm_mj._core import BUILT
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.cli.exit_codes import OK
from ffsm_mj.cli.standard_streams import Output
from ffsm_mj.experiments.file import campaign_schema, is_campaign
from ffsm_mj.experiments.planning import described, load_campaign
from ffsm_mj.experiments.uncertainty import uncertain_parameters
from ffsm_mj.scenario.schema import scenario_schema


def check(options: argparse.Namespace, output: Output) -> int:
    """Validate a scenario or a campaign and describe it; returns the exit code.

    Raises:
        InputError: It is invalid.
    """
    with output.progress() as stage:
        stage(f"compile {options.scenario}")
        if is_campaign(options.scenario):
            lines = described(load_campaign(options.scenario, options.overrides))
        else:
            prepared = prepare(options.scenario, options.overrides)
            uncertain = [f"uncertain: {parameter.size} in {parameter.key}" for parameter in uncertain_parameters(prepared)]
            lines = [*prepared.describe(), *uncertain, f"core: {BUILT}"]
    for line in lines:
        output.say(line)
    return OK


def schema(options: argparse.Namespace, output: Output) -> int:
    """Print the JSON Schema of scenario or campaign files; returns the exit code."""
    output.write(json.dumps((campaign_schema if options.campaign else scenario_schema)(), indent=2))
    return OK

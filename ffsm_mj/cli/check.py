"""Implementation of ``ffsm check`` and ``ffsm schema``: validation of input files, and their schemas."""

from __future__ import annotations

import argparse
import json

from ffsm_mj._core import BUILT
from ffsm_mj.assembly.prepare import prepare
from ffsm_mj.campaign.plan.description import description
from ffsm_mj.campaign.plan.loading import load_campaign
from ffsm_mj.campaign.plan.schema import campaign_schema
from ffsm_mj.campaign.plan.shipped import CAMPAIGNS
from ffsm_mj.cli.exit_codes import OK
from ffsm_mj.cli.standard_streams import Output
from ffsm_mj.scenario.schema import scenario_schema
from ffsm_mj.sensitivities.of_run import checked_parameters
from ffsm_mj.studies.description import study_description
from ffsm_mj.studies.plan import load_study
from ffsm_mj.studies.schema import study_schema
from ffsm_mj.studies.shipped import STUDIES


def check(options: argparse.Namespace, output: Output) -> int:
    """Validate a scenario, a campaign or a study and describe it; returns the exit code.

    Raises:
        InputError: It is invalid.
    """
    if CAMPAIGNS.has(options.scenario):
        plan = load_campaign(options.scenario, options.overrides)
        lines = description(plan, plan.design())
    elif STUDIES.has(options.scenario):
        lines = study_description(load_study(options.scenario, options.overrides))
    else:
        prepared = prepare(options.scenario, options.overrides)
        lines = [*prepared.describe(), *(f"uncertain: {each.size} in {each.key}" for each in checked_parameters(prepared))]
        lines.append(f"core: {BUILT}")
    for line in lines:
        output.say(line)
    return OK


def schema(options: argparse.Namespace, output: Output) -> int:
    """Print the JSON Schema of scenario, campaign or study files; returns the exit code."""
    made = campaign_schema if options.campaign else study_schema if options.study else scenario_schema
    output.say(json.dumps(made(), indent=2))
    return OK

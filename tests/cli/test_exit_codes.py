"""The help of a command lists the exit codes that it can have, and no others."""

from __future__ import annotations

import re

import pytest

from ffsm_mj.cli.command_line import COMMANDS
from ffsm_mj.cli.main import main

OF_EVERY_COMMAND = {0, 2, 3, 130}


def codes(capsys, *words):
    assert main([*words, "--help"]) == 0
    sentence = " ".join(capsys.readouterr().out.split()).partition("exit codes: ")[2]
    return {int(code) for code in re.findall(r"(?:^|; )(\d+) ", sentence)}


@pytest.mark.parametrize("command", COMMANDS)
def test_the_exit_codes_of_a_command(command, capsys):
    more = {"run": {1, 5}, "analyze": {1, 4, 5}, "export": {4}, "validate": {1}}
    assert codes(capsys, command) == OF_EVERY_COMMAND | more.get(command, set())


def test_the_exit_codes_of_the_program(capsys):
    assert codes(capsys) == OF_EVERY_COMMAND

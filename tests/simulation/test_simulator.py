"""The simulator that steps: the same run as in one go, commands of the caller's own, and states that can be restored."""

import signal
import threading
from collections import deque
from dataclasses import replace
from functools import partial
from random import Random
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

import ffsm_mj
from ffsm_mj.analysis.run_models import all_checks
from ffsm_mj.assembly.process import noted
from ffsm_mj.assembly.simulator import Simulator, SimulatorError, SimulatorState
from ffsm_mj.cli.main import main
from ffsm_mj.config import StrictModel
from ffsm_mj.controller_protocol import Command
from ffsm_mj.errors import InputError
from ffsm_mj.state import StateError
from ffsm_mj.unchanging import Unchanging, with_state
from tests.laws import Law

TAP = {"duration_s": 0.4}
"""Four impacts with a wall from 0.08 s on, then contact that lasts from 0.22 to 0.33 s; a control tick takes 5 ms."""
MOTORS = ("thruster_x", "thruster_y", "wheel", "motor_1", "motor_2", "motor_3")
COMMANDED = [f"{name}_command_{'N' if name.startswith('thruster') else 'N_m'}" for name in MOTORS]


def stepped(simulator, until="tick"):
    """Events of the rest of a run, and the run."""
    events = []
    while not simulator.ended:
        events += simulator.step(until=until).events
    return events, simulator.close()


def same(a, b):
    """Whether the rows of b are the last ones of a, bit for bit."""
    return len(b.log.rows) > 5 and np.array_equal(a.log.rows[-len(b.log.rows) :], b.log.rows, equal_nan=True)


@pytest.fixture(scope="module")
def tap():
    return ffsm_mj.run("tap", TAP)


@pytest.mark.long(one_of=3)
@pytest.mark.parametrize("until", ["tick", "event", 0.2])
def test_steps_are_the_run(tap, until):
    """Rows bit for bit, records and their order, whether steps end at ticks, at events or at a time."""
    simulator = Simulator("tap", TAP)
    simulator.reset()
    events = list(simulator.step(until=until).events)
    more, run = stepped(simulator, "tick" if until == 0.2 else until)
    assert same(tap, run)
    assert len(tap.log.rows) == len(run.log.rows)
    assert repr(run.records) == repr(tap.records)
    met = [each for each in events + more if hasattr(each, "separation_speed_m_s")]
    assert [each.time_s for each in met] == [each.time_s for each in tap.impacts]


def test_a_step_ends_at_an_event_before_its_decision():
    """A command given there acts from the event on, and is what the log says of the efforts after it."""
    simulator = Simulator("tap", TAP)
    simulator.reset()
    step = simulator.step(until="event")
    while not step.events or not hasattr(step.events[-1], "impulse_N_s"):
        step = simulator.step(until="event")
    (impact,) = step.events
    assert step.observation.time_s == impact.time_s == simulator.time_s
    assert not step.observation.at_tick
    names = simulator.system.names("actuator")
    simulator.step(np.full(len(names), 0.01))
    _, run = stepped(simulator)
    efforts = run.impacts[0].efforts_after
    assert {float(np.ravel(value)[0]) for value in efforts.values()} == {0.01}
    assert all(check.passes for check in all_checks(run))


def test_commands():
    """All actuators; one, the others left to the control law; a model; off. The law commands what is left to it."""
    simulator = Simulator("baseline", {"duration_s": 0.01})
    simulator.reset()
    names = simulator.system.names("actuator")
    assert tuple(name.removeprefix("robot/") for name in names) == MOTORS
    simulator.step()
    simulator.step({"motor_1": 0.5})
    simulator.step({"robot": [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]})
    simulator.step({"robot/motor_2": None})
    simulator.step([0.0, 0.0, 0.0, 0.0, 0.0, -1.0])
    simulator.step(Command.off(6))
    run = simulator.close()
    law = ffsm_mj.run("baseline", {"duration_s": 0.01})
    applied, own = (np.column_stack([each[f"actuators.robot_{key}"] for key in COMMANDED]) for each in (run, law))
    assert np.array_equal(applied[0], own[0])
    assert applied[1, 3] == 0.5
    np.testing.assert_allclose(applied[1, 4:], own[1, 4:], rtol=1e-12)
    np.testing.assert_array_equal(applied[2], [0.1, 0.2, 0.3, 0.4, 0.5, 0.6])
    assert applied[3, 4] == 0.0
    assert applied[3, 3] != 0.0
    np.testing.assert_array_equal(applied[4], [0.0, 0.0, 0.0, 0.0, 0.0, -1.0])
    assert not applied[5].any()


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ([1.0, 2.0], r"shape \(2,\), but one effort each is needed for robot/thruster_x, .*, robot/motor_3"),
        ({"motor_9": 1.0}, "unknown actuator 'motor_9'; did you mean|allowed: .*; or a model: robot"),
        ({"motor_1": [1.0, 2.0]}, r"command of 'motor_1': shape \(2,\)"),
        ({"motor_1": 1.0, "robot": np.zeros(6)}, "'robot' names actuators that another name gives too"),
        (np.full(6, np.nan), "efforts and setpoints must be finite: robot/thruster_x nan"),
        ("fast", "not numbers"),
    ],
)
def test_wrong_commands_change_nothing(given, message):
    simulator = Simulator("baseline", {"duration_s": 0.01})
    simulator.reset()
    with pytest.raises(InputError, match=message):
        simulator.step(given)
    assert simulator.time_s == 0.0
    _, run = stepped(simulator)
    assert run.outcome == "completed"


def test_misuse_is_named():
    simulator = Simulator("baseline", {"duration_s": 0.002})
    for use in (simulator.step, simulator.get_state, lambda: simulator.observation):
        with pytest.raises(SimulatorError, match="there is no run: reset"):
            use()
    assert simulator.close() is None
    simulator.reset()
    for until in ("never", np.nan, 0.0):
        with pytest.raises(InputError, match="until: "):
            simulator.step(until=until)
    with pytest.raises(InputError, match="seed: -1, allowed are"):
        simulator.reset(seed=-1)
    simulator.reset()
    assert simulator.step(until=1.0).ended == ("completed", "")
    with pytest.raises(SimulatorError, match=r"has ended \(completed at t = 0.002 s\): reset\(\) begins another"):
        simulator.step()
    assert simulator.close().outcome == "completed"
    assert simulator.close() is None


@pytest.mark.long(one_of=2)
@pytest.mark.parametrize("time_s", [0.1, 0.25])
def test_a_restored_state_goes_on_bit_for_bit(tap, time_s):
    """Between two impacts, and within contact that lasts; also after the simulator has gone on, and from a pickle."""
    simulator = Simulator("tap", TAP)
    simulator.reset()
    simulator.step(until=time_s)
    state = SimulatorState.from_bytes(simulator.get_state().to_bytes())
    assert same(tap, stepped(simulator)[1])
    again = Simulator("tap", TAP)
    assert again.set_state(state).time_s == pytest.approx(time_s, abs=1e-12)
    run = stepped(again)[1]
    assert same(tap, run)
    assert run.complete
    assert all(check.passes for check in all_checks(run))


def test_in_place_without_a_record(tap):
    """Without a log the same parts go on: as often as a search over commands needs it."""
    simulator = Simulator("tap", TAP, record=False)
    simulator.reset()
    simulator.step(until=0.25)
    state, seen = simulator.get_state(), []
    for _ in range(2):
        simulator.set_state(state)
        simulator.step(until=0.3)
        seen.append(simulator.observation.data.qpos.copy())
        simulator.step(np.ones(simulator.system.mj.nu))
    assert np.array_equal(*seen)
    row = np.searchsorted(tap.time, 0.3 - 1e-9)
    assert np.array_equal(seen[0], tap.qpos[row])


def test_a_state_at_an_event(tap):
    """Its decision is still due: the record that was not written yet comes with the new log."""
    simulator = Simulator("tap", TAP)
    simulator.reset()
    while not simulator.step(until="event").events or simulator.time_s < 0.1:
        pass
    state = simulator.get_state()
    assert same(tap, stepped(simulator, "event")[1])
    again = Simulator("tap", TAP)
    again.set_state(state)
    assert same(tap, stepped(again, "event")[1])


def test_the_log_of_a_restored_run_is_whole(tmp_path, capsys):
    """It begins with the state: its replay recomputes every number, with contacts closed and events numbered as before."""
    simulator = Simulator("tap", {"duration_s": 1.05}, record=tmp_path / "run")
    simulator.reset()
    simulator.step(until=0.25)
    simulator.set_state(simulator.get_state())
    stepped(simulator)
    assert main(["analyze", str(tmp_path / "run-2")]) == 0
    told = capsys.readouterr().out
    assert "columns agree with states" in told
    assert "damaged" not in told
    assert main(["analyze", str(tmp_path / "run")]) in (0, 1, 3)  # the first one was interrupted at 0.25 s
    assert "interrupted" in capsys.readouterr().out


def test_a_state_of_another_scenario_is_refused():
    first, second = Simulator("tap", TAP), Simulator("baseline", {"duration_s": 0.01})
    first.reset()
    with pytest.raises(SimulatorError, match="that of another scenario"):
        second.set_state(first.get_state())
    first.close()


class Keeps(Law):
    """Counts its calls, and has no word for that."""

    def __init__(self, config, context):
        self.calls = 0

    def control(self, observation, command):
        self.calls += 1


OF_SCRIPT = {"phases": [{"name": "a", "until": "end", "controller": {"kind": "law"}}], "duration_s": 0.02}
REMEMBERS = r"the control law 'law' of phase 'a' remembers '{}', and no state has it: give {} get_state\(\) and set_state"


def test_a_law_that_remembers_without_a_state_is_named():
    simulator = Simulator("baseline", OF_SCRIPT, controllers={"law": Keeps})
    simulator.reset()
    before = simulator.get_state()  # nothing has changed so far: any law that is made anew is as this one
    simulator.step()
    with pytest.raises(StateError, match=REMEMBERS.format("calls", "Keeps")):
        simulator.get_state()
    with pytest.raises(StateError, match="remembers 'calls'"):  # it cannot be taken back either
        simulator.assembly.controller.set_state(before.parts.controller, simulator.observation)
    simulator.close()

    class Says(Keeps):
        def get_state(self):
            return self.calls

        def set_state(self, state):
            self.calls = state

    simulator = Simulator("baseline", OF_SCRIPT, controllers={"law": Says}, record=False)
    simulator.reset()
    simulator.step()
    state, law = simulator.get_state(), simulator.assembly.controller.phases[0].controller
    simulator.step(until=0.01)
    assert law.calls == 10
    simulator.set_state(SimulatorState.from_bytes(state.to_bytes()))
    assert law.calls == 1
    simulator.close()


def test_a_log_with_states_names_it_too():
    run = ffsm_mj.run("tap", OF_SCRIPT | {"duration_s": 0.1, "log.states": "events"}, controllers={"law": Keeps})
    assert run.outcome in ("completed", "controller_failed")
    assert run.outcome == "completed" or "log.states" in run.message


def test_two_in_turn_and_in_threads(tap):
    """Nothing is shared: neither MuJoCo's warnings nor the parts of a run."""
    pair = [Simulator("tap", TAP) for _ in range(2)]
    for simulator in pair:
        simulator.reset()
    while not pair[0].ended:
        for simulator in pair:
            simulator.step()
    assert all(same(tap, simulator.close()) for simulator in pair)
    runs = []

    def go(simulator):
        simulator.reset()
        runs.append(stepped(simulator)[1])

    threads = [threading.Thread(target=go, args=(simulator,)) for simulator in pair]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert all(same(tap, run) for run in runs)


def test_reset_in_contact_begins_anew(tap):
    simulator = Simulator("tap", TAP)
    simulator.reset()
    simulator.step(until=0.25)
    simulator.reset()
    assert same(tap, stepped(simulator)[1])


class Few(list):
    """A list with an attribute."""

    total = 0

    def grow(self):
        self.total += 1


def counting():
    """A function that counts its calls in a variable of its own."""
    calls = 0

    def count():
        nonlocal calls
        calls += 1

    return count


def by_default(memo=[0.0]):  # noqa: B006 (what a user may do)
    memo[0] += 0.5


@pytest.mark.parametrize(
    ("made", "changed"),
    [
        (lambda: [np.random.default_rng(1)], lambda held: held[0].random()),
        (lambda: Random(3), lambda held: held.gauss()),
        (lambda: np.random.RandomState(4).normal, lambda held: held()),
        (lambda: deque([1.0, 2.0], maxlen=2), lambda held: held.append(3.0)),
        (lambda: {"a": [np.zeros(2)]}, lambda held: held["a"][0].fill(1.0)),
        (Few, Few.grow),
        (lambda: partial(Few.grow, Few()), lambda held: held()),
        (counting, lambda held: held()),
        (lambda: by_default, lambda held: held()),
        (lambda: iter([1, 2]), next),
        (lambda: (i for i in "ab"), next),
        (lambda: SimpleNamespace(x=SimpleNamespace(y=1)), lambda held: setattr(held.x, "y", 2)),
    ],
)
def test_wherever_a_law_remembers_it_is_seen(made, changed):
    """Random numbers, closures, defaults, containers with attributes, objects in objects; what cannot be looked into."""
    part = SimpleNamespace(held=made(), gain=2.0, config=StrictModel())
    watched = Unchanging(part, "it")
    changed(part.held)
    with pytest.raises(StateError, match="it remembers 'held'"):
        watched.get_state()


def test_what_does_not_change_is_no_memory():
    """Numbers, functions, systems, NaN, and an object that holds itself."""
    part = SimpleNamespace(a=float("nan"), f=np.sin, g=len, h=by_default, i=slice(1, 2), j=mujoco.MjModel, k=np.ones(2))
    part.itself = part
    watched = Unchanging(part, "it")
    watched.set_state(watched.get_state())
    part.late = 1
    with pytest.raises(StateError, match="it remembers 'late'"):
        watched.get_state()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_late_in_a_step_is_not_lost(number):
    """It comes after the step has last looked for one: the run ends as interrupted, the handlers are those of before."""
    before = signal.getsignal(number)
    simulator = Simulator("baseline", {"duration_s": 0.01})
    simulator.reset()
    step = simulator._run.simulation._grid_step
    check = step._check_finite
    step._check_finite = lambda: (check(), signal.raise_signal(number))
    with pytest.raises(KeyboardInterrupt):
        simulator.step()
    with pytest.raises(SimulatorError, match="the run has ended"):
        simulator.step()
    assert simulator.close().outcome == "interrupted"
    assert signal.getsignal(number) == before


@pytest.fixture
def default_interrupt():
    """Ctrl-C as in a program that a shell starts in the foreground; in the background it is ignored."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("default_interrupt")
def test_a_signal_after_another_thread_closed_a_simulator():
    """Only the main thread can remove handlers: they still pass a signal on, also when another simulator begins."""
    for _ in range(2):
        simulator = Simulator("baseline", {"duration_s": 0.01}, record=False)
        close_in_a_thread(simulator)
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)
    with simulator:
        simulator.reset()
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


@pytest.mark.usefixtures("default_interrupt")
def test_handlers_of_others_come_and_go_around_simulators():
    """After a context with a handler of its own, in which a simulator ran, a signal goes where it went before that."""
    close_in_a_thread(Simulator("baseline", {"duration_s": 0.01}, record=False))
    with noted() as is_noted:
        with Simulator("baseline", {"duration_s": 0.01}, record=False) as simulator:
            simulator.reset()
            signal.raise_signal(signal.SIGINT)
        assert is_noted()
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)
    with Simulator("baseline", {"duration_s": 0.01}, record=False) as simulator:
        simulator.reset()
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def close_in_a_thread(simulator):
    """Handlers that the main thread has installed stay."""
    simulator.reset()
    thread = threading.Thread(target=simulator.close)
    thread.start()
    thread.join()


def test_what_is_refused_leaves_the_run(tmp_path):
    """A wrong seed, a wrong override, and a state of other parts: the run under way goes on."""
    simulator = Simulator("baseline", {"duration_s": 0.01}, record=tmp_path / "run", rerun=False)
    simulator.reset()
    simulator.step()
    other = replace(simulator.get_state(), fingerprint="another")
    for refused in (lambda: simulator.reset(seed=-1), lambda: simulator.reset(overrides=["duration_s=-1"])):
        with pytest.raises(InputError):
            refused()
    with pytest.raises(SimulatorError, match="that of another scenario"):
        simulator.set_state(other)
    assert simulator.time_s == 0.001
    assert stepped(simulator)[1].outcome == "completed"
    assert [each.name for each in tmp_path.iterdir()] == ["run"]


class Shares(Keeps):
    """Hands out its own list as its state."""

    def __init__(self, config, context):
        self.calls = [0.0]

    def control(self, observation, command):
        self.calls[0] += 1.0

    def get_state(self):
        return self.calls

    def set_state(self, state):
        self.calls[:] = state


def test_a_state_shares_nothing_with_a_law():
    """What a law hands out is data at once: it stays as it is while the run goes on."""
    simulator = Simulator("baseline", OF_SCRIPT, record=False, controllers={"law": Shares})
    simulator.reset()
    state = simulator.get_state()
    before = state.to_bytes()
    simulator.step()
    assert state.to_bytes() == before
    assert simulator.get_state().to_bytes() != before
    simulator.set_state(state)
    assert simulator.get_state().to_bytes() == before


@pytest.mark.parametrize("told", [lambda: 1, object(), (i for i in "ab"), Few, 1j, np.array([None])])
def test_what_a_law_says_that_is_no_state_is_named(told):
    part = SimpleNamespace(get_state=lambda: told, set_state=lambda _: 1 / 0)
    named = with_state(part, "the control law 'mine'")
    with pytest.raises(StateError, match=r"^the control law 'mine', get_state: "):
        named.get_state()
    with pytest.raises(StateError, match=r"^the control law 'mine', set_state: ZeroDivisionError"):
        named.set_state(None)

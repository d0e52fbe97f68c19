"""A scenario as a Gymnasium environment."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box

from ffsm_mj.analysis.run import Run
from ffsm_mj.arrays import FloatArray
from ffsm_mj.assembly.prepare import Scenario
from ffsm_mj.assembly.simulator import Simulator, Step
from ffsm_mj.controller_protocol import ExternalCommand
from ffsm_mj.errors import InputError, ScenarioFaults
from ffsm_mj.gym.endings import Ending
from ffsm_mj.gym.rendering import Camera
from ffsm_mj.gym.rewards import EnvError, Transition
from ffsm_mj.gym.setup import Bound, bind, campaign_of, env_of, resets_of, reward_of, split_env
from ffsm_mj.records.events import Outcome
from ffsm_mj.scenario.env_config import EnvConfig
from ffsm_mj.scenario.overrides import Overrides


class ScenarioEnv(gymnasium.Env[FloatArray, FloatArray]):
    """An episode is a run of the scenario, a step one control tick or several, as the key ``env`` says.

    Every reset has a number, ``seed=k`` that of k, without a seed the next one: it takes row k modulo n of the design of the
    campaign ``env.design``, and the noise that run k of the campaign has. An instance serves one thread at a time.

    Attributes:
        simulator: The simulation; it must not be stepped by others.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array", "rerun"], "render_fps": 50}

    def __init__(
        self,
        scenario: Scenario | Mapping[str, Any] | str | Path,
        env: Mapping[str, Any] | None = None,
        overrides: Overrides = (),
        *,
        stride: int = 1,
        render_mode: str | None = None,
        width: int = 640,
        height: int = 480,
        camera: str | int = -1,
        viewer: str = "127.0.0.1:9876",
        record: str | Path | None = None,
        force: bool = False,
    ) -> None:
        """Read, validate and compile a scenario; :meth:`reset` must follow.

        Args:
            scenario: See :func:`ffsm_mj.run`.
            env: Keys of the section ``env`` that replace those of the file; ``reward`` may be a function of a
                :class:`~ffsm_mj.gym.rewards.Transition`.
            overrides: Overrides of the scenario; see :func:`ffsm_mj.run`.
            stride: Numbers by which a reset without a seed moves on; of n environments in a vector that share one design,
                n, so that no two take the same row.
            render_mode: ``rgb_array``: :meth:`render` returns an image; ``rerun``: episodes are streamed to a Rerun viewer.
            width: Width of images, pixels.
            height: Height of images, pixels.
            camera: Name or id of a camera of the models; -1: one that frames the scene.
            viewer: ``host:port`` of the Rerun viewer.
            record: Run folder to write, a numbered one for each further episode; None: episodes leave no log.
            force: Replace a run that ``record`` already holds.

        Raises:
            InputError: The scenario, its section ``env``, a model or the design is wrong.
        """
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise InputError(f"render_mode: {render_mode!r}, allowed are {', '.join(self.metadata['render_modes'])}")
        if stride < 1:
            raise InputError(f"stride: {stride}, must be at least 1")
        reward, changes = split_env(env, overrides)

        def simulator(changes: Sequence[str]) -> Simulator:
            live = viewer if render_mode == "rerun" else None
            kept = record or False  # no rows in memory
            return Simulator(scenario, changes, record=kept, force=force, live=live, rerun=False)

        self.simulator = simulator(changes)
        plan = campaign_of(self.simulator.prepared)
        if plan is not None and plan.overrides:
            self.simulator = simulator([*plan.overrides, *changes])
        prepared = self.simulator.prepared
        self.config: EnvConfig = env_of(prepared)
        self._reward = reward_of(reward, prepared)
        self._resets, self._stride, self._next = resets_of(plan, prepared), stride, 0
        self._source = prepared.source
        parts = self._bind(prepared.assemble())
        self.action_space = Box(-1.0, 1.0, (parts.actions.size,), np.float32)
        self.observation_space = Box(parts.observations.low, parts.observations.high, dtype=np.float64)
        period_s = prepared.scenario.control_period_s * self.config.ticks_per_step
        self.metadata = {**self.metadata, "render_fps": 1.0 / period_s}
        self.render_mode = render_mode
        self._picture = width, height, camera
        self._camera: Camera | None = None
        self._bound: Bound | None = None
        self._vector = np.zeros(0)
        self._ending = "there is no episode"

    def _bind(self, assembly: Any) -> Bound:
        try:
            return bind(self.config, assembly, lambda: self.simulator.unhandled_overlaps)
        except ScenarioFaults as faults:
            raise self._source.located(faults.faults) from faults

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[FloatArray, dict[str, Any]]:
        """Begin an episode.

        Args:
            seed: Number of the reset, from 0; None: the next one.
            options: ``overrides``: further overrides of the scenario for this episode, by dotted key.

        Returns:
            The observation, and ``row`` of the design (-1 without one), ``seed`` of the noise, ``time_s`` and ``events``.

        Raises:
            InputError: The scenario does not allow the overrides.
        """
        super().reset(seed=seed)
        number = self._next if seed is None else int(seed)
        reset = self._resets.reset(number)
        self._ending, self._bound = "there is no episode", None
        self._close_camera()
        seen = self.simulator.reset(seed=reset.seed, overrides=reset.overrides | dict((options or {}).get("overrides", {})))
        self._bound = self._bind(self.simulator.assembly)
        self._bound.episode.look(seen)
        self._next = number + self._stride
        self._vector, self._ending, self._memory = self._bound.observations.read(seen), "", dict[str, Any]()
        return self._vector.copy(), {"row": reset.row, "seed": reset.seed, "time_s": seen.time_s, "events": ()}

    def step(self, action: FloatArray) -> tuple[FloatArray, float, bool, bool, dict[str, Any]]:
        """Simulate ``ticks_per_step`` control ticks, or up to the end of the episode.

        Args:
            action: Numbers from -1 to 1, (n,); others are clipped.

        Returns:
            Observation, reward, whether the episode has ended (success, failure, forbidden contact, bound, or a motion that
            cannot be simulated further), whether the duration is over, and ``events``, the records of contacts, grasps and
            phases in the step, ``time_s``, ``success``, and ``ending``, why it has ended.

        Raises:
            EnvError: The episode has ended; the action has another shape or is not finite; the reward or an observation is
                not a finite number; or software failed.
        """
        bound = self._bound
        if bound is None or self._ending:
            raise EnvError(f"no step can be taken ({self._ending}): reset() begins another episode")
        numbers = bound.actions.checked(action)
        events, step, ending = self._simulate(bound, numbers)
        over = step.ended is not None and step.ended.outcome == Outcome.COMPLETED and self._is_over(step)
        truncated = over and ending is None
        before, terminated = self._vector, ending is not None
        diverged = step.ended is not None and step.ended.outcome != Outcome.COMPLETED
        self._vector = before if diverged else bound.observations.read(step.observation)
        success = ending is not None and ending.success
        self._ending = ending.reason if ending is not None else "duration" if truncated else ""
        transition = Transition(
            time_s=step.observation.time_s,
            action=numbers,
            before=before,
            after=self._vector,
            events=events,
            success=success,
            failure=terminated and not success,
            truncated=truncated,
            seen=step.observation,
            system=bound.system,
            memory=self._memory,
        )
        info = {"events": events, "time_s": transition.time_s, "success": success, "ending": self._ending}
        return self._vector.copy(), self._reward.of(transition), terminated, truncated, info

    def _simulate(self, bound: Bound, numbers: FloatArray) -> tuple[tuple[Any, ...], Step, Ending | None]:
        """Records, last control tick and end of a step."""
        events: list[Any] = []
        seen = self.simulator.observation
        for _ in range(self.config.ticks_per_step):
            step = self._tick(bound.actions.command(numbers, seen))
            seen = step.observation
            events += step.events
            bound.episode.add(step.events)
            bound.episode.look(seen)
            ending = bound.endings.reached(seen, step.events)
            if step.ended is not None:
                ending = ending or self._ended(step)
            if step.ended is not None or ending is not None:
                break
        return tuple(events), step, ending

    def _tick(self, command: ExternalCommand) -> Step:
        """Simulate to the next control tick.

        Raises:
            EnvError: A control law, an estimator or a contact model failed, or the log cannot be written.
        """
        try:
            step = self.simulator.step(command)
        except Exception as error:
            raise self._failure() from error
        if step.ended is not None and step.ended.outcome == Outcome.WRITE_FAILED:
            raise self._failure()
        return step

    def _failure(self) -> EnvError:
        """Error of software that has ended the run, and the episode with it."""
        ended = self.simulator.ended
        self._ending = ended.outcome.value if ended is not None else "an error"
        return EnvError(f"the episode has ended ({self._ending}): {ended.message if ended is not None else ''}")

    def _ended(self, step: Step) -> Ending | None:
        """End of an episode whose run has ended; None if its duration is over."""
        assert step.ended is not None
        if step.ended.outcome != Outcome.COMPLETED:
            return Ending(False, step.ended.outcome.value)
        return None if self._is_over(step) else Ending(False, "end of the run")

    def _is_over(self, step: Step) -> bool:
        scenario = self.simulator.prepared.scenario
        return step.observation.time_s > scenario.duration_s - 0.5 * scenario.control_period_s

    def render(self) -> Any:
        """With ``rgb_array`` an image of the present, RGB, (height, width, 3); otherwise None.

        Raises:
            EnvError: There is no episode.
            RenderError: There is no OpenGL, or no such camera.
        """
        if self.render_mode != "rgb_array":
            return None
        if self._bound is None:
            raise EnvError("there is nothing to render: reset() begins an episode")
        if self._camera is None:
            self._camera = Camera(self._bound.system.mj, self._bound.data, *self._picture)
        return self._camera.image(self._bound.data)

    def _close_camera(self) -> None:
        camera, self._camera = self._camera, None
        if camera is not None:
            camera.close()

    def finish(self) -> Run | None:
        """End the episode under way and return its run with checks and log; None without an episode."""
        self._ending, self._bound = "there is no episode", None
        self._close_camera()
        return self.simulator.close()

    def close(self) -> None:
        """End the episode under way; its log is closed. Further calls do nothing."""
        self.finish()

"""Small data sets in the formats of the measured ones: impacts of known (mu, e), tosses of our own, a script with lists."""

from __future__ import annotations

import io
import pickle
import struct
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
from scipy.io import savemat

from ffsm_mj.validation.measured.tosses import HALF_WIDTH_M
from ffsm_mj.validation.measured.tossing import TossTask, simulate
from tests.identification.synthetic import ellipses

SCRIPT = "examples/dem/3d-oblique-wall-impact/oblique_wall_impact_postprocessing.py"


def write_ellipses(folder: Path, *, mirrored: bool = False, change=lambda data, models: (data, models)) -> Path:
    """60 exact impacts of (0.18, 0.59), seed 0, as MATLAB files; returns the folder."""
    impacts = ellipses(60)
    impacts = impacts.with_reversed_tangents() if mirrored else impacts
    poses = np.zeros((len(impacts), 3))
    data = {
        "states_i": np.hstack([poses, impacts.before]),
        "states_f": np.hstack([poses, impacts.after]),
        "n": impacts.normal,
        "d": impacts.tangents[:, 0],
    }
    data, models = change(data, {"v_models": np.tile(impacts.before, 6)})
    (folder / "processed_data").mkdir(parents=True)
    savemat(folder / "processed_data" / "data_ellipse.mat", {"data": data})
    savemat(folder / "processed_data" / "v_models.mat", models)
    return folder


def legacy_tensor(table: np.ndarray, *, storage: str = "DoubleStorage", rebuild: str = "_rebuild_tensor_v2") -> bytes:
    """A tensor (1, n, m) as PyTorch before 1.6 pickles it."""
    modules = {"torch": ModuleType("torch"), "torch._utils": ModuleType("torch._utils")}
    kind = type(storage, (), {"__module__": "torch"})
    setattr(modules["torch"], storage, kind)

    def function(*_):
        raise AssertionError("never called")

    function.__name__ = function.__qualname__ = rebuild
    function.__module__ = "torch._utils"
    setattr(modules["torch._utils"], rebuild, function)

    class Tensor:
        def __reduce__(self):
            n, m = table.shape
            return function, (_Storage(), 0, (1, n, m), (n * m, m, 1), False, {})

    class _Storage:
        pass

    class Pickler(pickle.Pickler):
        def persistent_id(self, obj):
            return ("storage", kind, "1", "cpu", table.size, None) if isinstance(obj, _Storage) else None

    before = {name: sys.modules.get(name) for name in modules}
    sys.modules.update(modules)
    try:
        file = io.BytesIO()
        for part in (0x1950A86A20F9469CFC6C, 1001, {"little_endian": True}, Tensor(), ["1"]):
            Pickler(file, protocol=2).dump(part)
    finally:
        for name, module in before.items():
            sys.modules.pop(name)
            if module is not None:
                sys.modules[name] = module
    return file.getvalue() + struct.pack("<q", table.size) + np.asarray(table, dtype="<f8").tobytes()


def toss_table(task: TossTask) -> np.ndarray:
    """A toss by this engine as such a file has it, (n, 19): lengths in half widths, tabulated velocities at the start."""
    motion = simulate(task)
    table = np.zeros((task.frames, 19))
    table[:, :3] = motion.positions / HALF_WIDTH_M
    table[:, 3:7] = motion.rotations.as_quat(scalar_first=True)
    table[0, 7:10] = task.start[7:10] / HALF_WIDTH_M
    table[0, 10:13] = task.start[10:]
    return table


def write_script(folder: Path, angles: object, ratios: object) -> Path:
    """A script with the two lists, which must not be executed; returns the folder."""
    path = folder / SCRIPT
    path.parent.mkdir(parents=True)
    lists = f"theta_restitution_exp = {angles}\nrestitution_exp = {ratios}\n"
    path.write_text(f"import nowhere\nraise SystemExit('executed')\n{lists}")
    return folder

"""The figure of ``docs/persistent-contact.md``, from the scenario as it is: ``make figures``.

Above the impulses of the hits of `push`, each a fraction of the last, below the force of the contact that they end in.
"""

from __future__ import annotations

from pathlib import Path

from matplotlib.figure import Figure

import ffsm_mj
from ffsm_mj.report.plots.style import BLUE, VERMILION, WIDTH_IN, publication, write

FOLDER = Path(__file__).parent / "figures" / "push"
UNTIL_S = 10.2
SHOWN_S = (7.6, UNTIL_S)


def main() -> None:
    """Run the scenario as far as the figure goes, draw, write."""
    run = ffsm_mj.run("push", {"duration_s": UNTIL_S})
    with publication():
        figure = Figure(figsize=(WIDTH_IN, 0.55 * WIDTH_IN))
        hits, forces = figure.subplots(2, 1, sharex=True)
        for name, colour, flies in (("bounces, e = 0.3", BLUE, True), ("settles: entry by rule (10)", VERMILION, False)):
            mine = [impact for impact in run.impacts if (impact.restitution_used > 0.0) is flies]
            times, impulses = [impact.time_s for impact in mine], [impact.impulse_N_s for impact in mine]
            hits.vlines(times, 1e-4, impulses, colors=colour, linewidth=0.8)
            hits.plot(times, impulses, "o", color=colour, markersize=4, label=name)
        hits.set(yscale="log", ylim=(1e-4, 3.0), ylabel="impulse of a hit, N s")
        hits.legend(loc="upper right")
        forces.plot(run.time, run["contact.gripper_box_force_N"], color=BLUE)
        (contact,) = run.contacts
        forces.axvspan(contact.start_s, contact.end_s, color=BLUE, alpha=0.08, linewidth=0.0, label="closed")
        forces.set(xlim=SHOWN_S, xlabel="time, s", ylabel="contact force, N")
        forces.legend(loc="upper right")
    FOLDER.mkdir(parents=True, exist_ok=True)
    write(figure, FOLDER, "contact_force", ("svg",))


if __name__ == "__main__":
    main()

"""Notes on pairs of geoms of an assembled scenario: those that overlap, or cannot meet."""

from __future__ import annotations

from collections.abc import Iterator

from ffsm_mj.assembly.assemble import Assembly
from ffsm_mj.contact.watch import ContactWatch
from ffsm_mj.contact_models.grasp.model import GraspModel


def unwatched_overlaps(assembly: Assembly) -> Iterator[tuple[str, str]]:
    """Labels of geoms that overlap initially, whose contacts are neither resolved nor ignored."""
    watch = ContactWatch(assembly.system.mj, assembly.data, assembly.known_pairs, filtered=assembly.contacts.left_out)
    watch.look(0.0)
    for record in watch.finish(0.0):
        yield record.geoms[0], record.geoms[1]


def disarmed_pairs(assembly: Assembly) -> Iterator[str]:
    """Pairs that cannot meet while a rigid grasp is closed."""
    for contact_model in assembly.plant.integrator.sources:
        if isinstance(contact_model, GraspModel):
            for name, pairs in contact_model.disarmed.items():
                if not pairs:
                    continue
                found = [pair.name for pair in assembly.pairs if pair.geom_ids in pairs]
                others = len(pairs) - len(found)
                yield (
                    f"while {name!r} is closed, {len(pairs)} pairs of geoms are on one rigid body and cannot meet: "
                    f"{', '.join([*found, *([f'{others} without a contact rule'] if others else [])]) or 'none'}"
                )

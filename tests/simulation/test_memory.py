"""The walk of the objects of a simulation: complete, the same in every process, and without a trace in these objects."""

import gc
import sys

import numpy as np
import pytest

from ffsm_mj.simulation.memory import Memory


class Part:
    """Holds a dictionary first, so that it could be taken for that of its attributes."""

    def __init__(self):
        self.by_name = {"a": [1.0]}


class Whole(Part):
    """Attributes of both kinds."""

    __slots__ = ("grid", "last")

    def __init__(self):
        super().__init__()
        self.part, self.last, self.grid = Part(), np.zeros(2), [Part()]


WALK = ("Whole", "list", "ndarray", "dict", "Part", "Part", "list", "dict", "dict", "list", "list")


@pytest.mark.parametrize("read", [False, True])
def test_the_walk_does_not_depend_on_what_has_read_the_attributes(read):
    """Numbers of objects are places in the walk: they must not change because something has read ``__dict__``."""
    whole = Whole()
    if read:
        assert vars(whole)
        assert vars(whole.part)
    assert Memory((), whole=whole).structure == WALK


@pytest.mark.skipif(sys.version_info >= (3, 13), reason="reading __dict__ has no effect on later access there")
def test_the_walk_does_not_read_the_dictionary_of_attributes():
    """Attributes whose dictionary has been read are slower, in all steps after the walk."""
    whole = Whole()
    before = gc.get_referents(whole)
    Memory((), whole=whole)
    assert [id(each) for each in gc.get_referents(whole)] == [id(each) for each in before]
    assert any(each is whole.part for each in before)

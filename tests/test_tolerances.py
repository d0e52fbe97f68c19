"""Relations between the shared tolerances that their derivations assume."""

from __future__ import annotations

from ffsm_mj import tolerances as t


def test_drift_and_landing_are_found_before_the_check_of_penetration_fails():
    """A point may land while others have drifted: both together stay within the contact gap."""
    assert t.LIFT_OFF_M == t.PROJECTED_GAP_M < t.DRIFT_M < t.LANDING_DEPTH_M < t.CONTACT_GAP_M


def test_queries_are_coarser_than_contact():
    """The distance query only selects pairs: the support functions decide contact."""
    assert t.MERGED_M < t.CONTACT_GAP_M < t.DISTANCE_QUERY_M < t.CLEARLY_APART_M


def test_meshes_in_single_precision_have_parallel_faces():
    """The rounding of one coordinate, 2^-24, is below the precision assumed, which is below the angle of parallel faces."""
    assert 2.0**-24 < t.MESH_PRECISION < t.PARALLEL


def test_solutions_pass_the_checks():
    """A solution within its tolerance passes; the tolerances of rounding are far above the rounding of a few operations."""
    assert t.APPROACHING < t.SOLVED <= t.CHECK_TOLERANCE
    assert min(t.CANCELLED, t.RATE, t.ENERGY_GAIN, t.NEWTON_STEP) > 1000.0 * t.EPSILON
    assert t.EVENT_TIME >= 4.0 * t.EPSILON  # the least that Brent's method accepts

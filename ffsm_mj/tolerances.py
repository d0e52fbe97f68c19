"""Numerical tolerances that several modules share or that depend on each other, with their derivation.

A suffix names the unit; a tolerance without a suffix is relative to what its docstring names. A tolerance that one module
alone uses, and no other depends on, stands in that module.

Double precision bounds all of them from below. Coordinates of a scene are of the order of 1 m to 10 m and are known to some
1e-15 m; what follows from them by a few hundred operations (a gap, a gap rate) is known to about 1e-13. The checks of a
finished run bound them from above: they allow 1e-9 (1 + scale), so a decision within 1e-9 does not make a check fail.
"""

from __future__ import annotations

EPSILON = 2.0**-52
"""Distance from 1 to the next larger double-precision number."""
CANCELLED = 1e-12
"""A difference below this share of the numbers that cancel in it is rounding: about 5000 EPSILON.

The share for exact data, such as rows of Jacobians and the velocities of an impact; see RANK for rows that contain normals.
"""
RANK = 1e-10
"""Singular values below this share of the largest are zero, for rows that contain normals or poses, known to about 1e-10."""
MECHANISM_RANK = 1e-6
"""The same for rows of equality constraints of model files, whose numbers are rounded: of Toddlerbot to 1e-8.

Of 62 public robots the least singular value that counts is 8.5e-4, and the largest that does not 3.5e-9. A motion that
brings one that counts below this share is singular.
"""

# ---- Checks and the solutions that they judge

CHECK_TOLERANCE = 1e-9
"""A check passes if its residual is at most this times (1 + scale), in SI units; see ``verification/checks.py``."""
SOLVED = 1e-9
"""Residual of an impact law over the largest contact speed below which its solution is accepted: that of the checks."""
APPROACHING = 1e-10
"""Approach slower than this share of the largest contact speed is rounding to an impact law.

It lies between the residual at which the iterations of a law end (1e-11 and less) and SOLVED, which the result must meet:
contacts that one pass has brought to rest do not start another.
"""
ENERGY_GAIN = 1e-12
"""Growth of kinetic energy over the energy before that counts as rounding, as in CANCELLED.

The check of an impact of several contacts allows the same gain, one thousandth of CHECK_TOLERANCE.
"""

# ---- Gaps and positions

CONTACT_GAP_M = 1e-9
"""Pairs, points of a face and contact features with a gap of at most this are in contact.

The check ``no penetration`` allows the same depth. Event localisation ends at gaps of 1e-14 m to 1e-13 m, and a closed
contact drifts by at most DRIFT_M before it is projected, so a contact that persists stays within this gap.
"""
FEATURE_BOUND_M = CONTACT_GAP_M
"""A contact leaves its feature this far outside the bounds, and enters one within half of it.

The difference is the hysteresis: without it a contact at a bound would change its feature at every evaluation.
"""
FLAT_M = CONTACT_GAP_M / 2.0
"""A cap that rolls on its rim lands flat where the highest point of the rim is this far above the lowest one.

The whole rim is then in contact with the face, and stays so up to CONTACT_GAP_M: the difference is the hysteresis.
"""
DRIFT_M = CONTACT_GAP_M / 2.0
"""A step ends early where a closed gap has drifted this far; the drift is then projected out."""
OTHER_POINT_M = CONTACT_GAP_M / 5.0
"""A closed pair whose gap is this much below that of its active contact points touches at another point."""
LANDING_DEPTH_M = OTHER_POINT_M + DRIFT_M
"""Largest overlap of any point of a closed pair before it is detected, given that active points may have drifted.

It is below CONTACT_GAP_M, so a point that lands is found before the check ``no penetration`` fails.
"""
FLUSH_M = OTHER_POINT_M / 4.0
"""Two round sides lie along each other where their gap varies by less than this over the length that they share.

Sides of radii r1 and r2 at an angle part by y^2 / (2 (r1 + r2)) where their axes are offset by y across the normal. Between
such sides the contact would run over their whole length at a tilt of 1e-9 rad: they touch at both ends instead.
"""
PROJECTED_GAP_M, PROJECTED_RATE_M_S = 1e-11, 1e-10
"""Gaps and gap rates within these are not projected: far below DRIFT_M, above the rounding of a gap (about 1e-13 m)."""
PROJECTED_SLIP_M_S = 1e-12
"""Slip of a sticking point that is not projected: RATE, so that it creeps by less than CONTACT_GAP_M in 1000 s."""
LIFT_OFF_M = PROJECTED_GAP_M
"""Contacts that would lift off by less than this height stay closed: a gap of this size is not projected either."""
DISTANCE_QUERY_M = 1e-7
"""What a distance of ``mj_geomDistance`` may be wrong by: below this it is evaluated again on the support functions.

Between spheres, capsules, boxes and meshes, and of spheres from cylinders, it is exact to rounding, except at flat contacts,
whose witness points are not unique. On ellipsoids and on the rims and sides of cylinders it iterates with triangles of
support points. A witness point lies within the surface by the sagitta of such a triangle, and one of edge a has a squared
area of a^4, which is rounding from a^2 = sqrt(EPSILON) size^2 on: 1e-9 of the size, whatever ``ccd_tolerance`` is. Under one
unit in the last place of the poses it scatters by as much: by 1e-11 to 2e-9 m for geoms of 0.1 to 3 m at gaps from 1e-9 to
1 m, at most 8e-8 m in 36 000 random pairs (a box that almost lies on the rim of a cylinder).
"""
CLEARLY_APART_M = 10.0 * DISTANCE_QUERY_M
"""At distances above this the witness points of ``mj_geomDistance`` give the direction; below, the pair is near contact."""
SAME_POINT_M = CLEARLY_APART_M
"""Contact points of one pair within this distance are one: mesh vertices are known to MESH_PRECISION of their radius."""
MERGED_M = 1e-12
"""Corners of one feature within this distance are one: a thousand times the rounding of coordinates of 1 m."""

# ---- Directions and shapes

PARALLEL = 1e-6
"""Directions within this angle, in rad, are parallel: an edge or face this close to perpendicular to the normal is extreme.

Vertices of meshes are stored in single precision, which tilts a face by about MESH_PRECISION over its width.
"""
CROSSING = 1e-4
"""Least angle, in rad, at which the rims of two caps that lie on each other cross.

Discs with rims at a smaller angle overlap by less than 1e-8 of their radius, or one lies within the other but for as much.
"""
MESH_PRECISION = 2e-7
"""Vertices of a mesh are known to this share of its bounding radius: single precision is 6e-8 per coordinate."""
STRAIGHT = 1e-9
"""A corner of a polygon that turns by less than this area over its squared extent is none.

Between sides of a tenth of the extent a corner thus turns by at least 1e-7 rad, more than rounding of coordinates does.
"""
NEWTON_STEP = 1e-12
"""Newton's method on a closest point ends at steps below this, in rad or relative; convergence is quadratic there."""

# ---- Gap rates and accelerations

RATE = 1e-12
"""Gap rates within this share of (1 m/s + the speeds of both bodies) are rounding: about 5000 EPSILON."""
CLOSED_RATE = 1e-6
"""The same for a closed pair: its gap rate drifts by the truncation error of a step until the next projection."""
DRIFT_M_S = CLOSED_RATE / 2.0
"""A step ends early where a closed gap rate has drifted this far, as with DRIFT_M: the pair still counts as closed there.

A round side that rolls along another one at a small angle turns at hundreds of rad/s: whole steps would be too long for it.
"""
ACCELERATION = 1e-10
"""Second rates of a gap within this share of their largest term are rounding: normals are known to about 1e-10."""
ACCELERATION_M_S2 = 1e-12
"""Second rates of a gap within this are rounding where all terms vanish; it moves a gap by 5e-10 m in 30 s."""

# ---- Times

EVENT_TIME_S = 1e-13
"""Tolerance of event localisation: at 1 m/s a gap of 1e-13 m, its rounding."""
EVENT_TIME = 8.9e-16
"""Relative part of the same: four EPSILON, the least that Brent's method (``scipy.optimize.brentq``) accepts."""

INSTANT_S = 100.0 * EVENT_TIME_S
"""Events within this are at one instant; see :mod:`ffsm_mj.ties`.

Roots of two conditions that hold at one time differ by EVENT_TIME_S each, and by the rounding of what is zero there over its
rate: 1e-13 m at 1 cm/s. An event that comes an instant late at 10 m/s moves a gap by 1e-10 m, a tenth of CONTACT_GAP_M.
"""
SHORTEST_S = EVENT_TIME_S
"""No part of a step is shorter, before an event or after it."""
INSTANT = 4.0 * EVENT_TIME
"""Relative part of both: 16 EPSILON. Logged times are known to half an EPSILON: their differences tell a part of a step."""
SCHEDULED_S = 1e-9
"""Scheduled times within this are one: decimals of a file, products of steps and sums of delays differ by rounding.

What is scheduled (samples, arrivals, control ticks) decides by them, and no state is moved by so much.
"""

# ---- Steps of springs and dampers

MODE_STEP = 0.3
"""Largest h w of a mode of joint springs: RK4 takes (h w)^6 / 72 = 1e-5 of its energy in each step."""
STIFF_STEP = 0.3
"""Largest h lambda of servos in explicit steps: RK4 resolves a decay exp(-lambda t) to (h lambda)^5 / 120 = 2e-5 of it."""
RESOLVED_STEP = 0.01
"""Largest h lambda of servos at which steps need no control: their truncation, (h lambda)^5 / 120 each, is in 1 / lambda
(h lambda)^4 / 120 = 8e-11 of the energy, a tenth of what the checks allow."""
DAMPER_STEP = 2.7
"""Largest h d / I of a damper: RK4 is stable up to 2.785 on the negative real axis."""

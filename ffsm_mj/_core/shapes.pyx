# cython: boundscheck=False, wraparound=False, cdivision=True
"""Convex geoms at a pose: extreme points and extents along directions, and where a point is nearest to them."""

import numpy as np

import mujoco

from libc.math cimport copysign, cos, fabs, hypot, INFINITY, sin, sqrt

from ffsm_mj._core.algebra cimport dot
from ffsm_mj._core.memory cimport numbers, room
from ffsm_mj.tolerances import CONTACT_GAP_M, EPSILON, MESH_PRECISION, PARALLEL


cdef int PLANE = mujoco.mjtGeom.mjGEOM_PLANE, SPHERE = mujoco.mjtGeom.mjGEOM_SPHERE, CAPSULE = mujoco.mjtGeom.mjGEOM_CAPSULE
cdef int ELLIPSOID = mujoco.mjtGeom.mjGEOM_ELLIPSOID, CYLINDER = mujoco.mjtGeom.mjGEOM_CYLINDER
cdef int BOX = mujoco.mjtGeom.mjGEOM_BOX, MESH = mujoco.mjtGeom.mjGEOM_MESH
cdef double _GAP = CONTACT_GAP_M
cdef double _EPSILON = EPSILON
cdef double _PARALLEL = PARALLEL
cdef double _PRECISION = MESH_PRECISION
cdef double _TINY = 1e-300  # divides what is zero only where its quotient does not count
cdef double _PI = np.pi

cdef enum:
    DISC = 8  # fixed points that represent the rim of a cap


cpdef bint lies_flat(double sine, double radius, double tolerance=0.0):
    """Whether a cap is in contact with a face all round its rim, not at the lowest point of it alone.

    Args:
        sine: Sine of the angle between its axis and the normal.
        radius: Its radius, m.
        tolerance: Tolerance to which points of the face are known, m.
    """
    return sine <= _PARALLEL and 2.0 * radius * sine <= _GAP + tolerance


cdef class PosedGeom:
    """One convex geom, or a part of it, at its pose in MuJoCo's data; see :class:`~ffsm_mj.contact.shape.Shape`."""

    cdef readonly object _model, _data, _part  # they keep alive what the pointers lead to
    cdef readonly int _kind, _geom
    cdef const double* size
    cdef const double* rotation  # by rows
    cdef const double* position
    cdef const double[:, :] corners  # of a part
    cdef const float[:, :] vertices  # of a mesh
    cdef double radius  # of the sphere around a mesh or part, m

    def __init__(self, model, data, int geom, part=None):
        """Take the pose of a geom (id), or of a part of it; kinematics in ``data`` must be current from here on."""
        cdef const double[:, ::1] sizes = model.geom_size, rotations, positions
        cdef Py_ssize_t first, row = geom
        self._model, self._data, self._geom, self._part = model, data, geom, part
        self.size = &sizes[geom, 0]
        if part is None:
            self._kind, rotations, positions = model.geom_type[geom], data.geom_xmat, data.geom_xpos
        else:
            self._kind, row, rotations, positions = MESH, part.body, data.xmat, data.xpos
            self.corners, self.radius = part.corners, part.radius
        self.rotation, self.position = &rotations[row, 0], &positions[row, 0]
        if self._kind == MESH and part is None:
            mesh = model.geom_dataid[geom]
            first = model.mesh_vertadr[mesh]
            self.vertices = model.mesh_vert[first : first + model.mesh_vertnum[mesh]]
            self.radius = model.geom_rbound[geom]

    @property
    def is_plane(self):
        """Whether it is a half-space."""
        return self._kind == PLANE

    @property
    def axis(self):
        """Its z axis, world axes, (3,): the outward normal of a plane."""
        cdef double[::1] axis = np.empty(3)
        axis[0], axis[1], axis[2] = self.rotation[2], self.rotation[5], self.rotation[8]
        return axis.base

    def core(self):
        """Ends of the axis of a capsule, the middle of a sphere twice, m, (2, 3)."""
        cdef double half = self.size[1] if self._kind == CAPSULE else 0.0
        cdef double[:, ::1] ends = np.empty((2, 3))
        cdef int i
        for i in range(3):
            ends[0, i] = self.position[i] - half * self.rotation[3 * i + 2]
            ends[1, i] = self.position[i] + half * self.rotation[3 * i + 2]
        return ends.base

    cdef inline void to_local(self, const double* vector, double* out) noexcept:
        """Turn a vector of world axes into its axes."""
        cdef const double* R = self.rotation
        cdef int i
        for i in range(3):
            out[i] = R[i] * vector[0] + R[3 + i] * vector[1] + R[6 + i] * vector[2]

    cdef inline double height(self, Py_ssize_t i, const double* local) noexcept:
        """Coordinate of a vertex along a direction, both in its axes."""
        if self._part is None:
            return self.vertices[i, 0] * local[0] + self.vertices[i, 1] * local[1] + self.vertices[i, 2] * local[2]
        return self.corners[i, 0] * local[0] + self.corners[i, 1] * local[1] + self.corners[i, 2] * local[2]

    cdef inline Py_ssize_t count(self) noexcept:
        """Number of vertices of a mesh."""
        return self.vertices.shape[0] if self._part is None else self.corners.shape[0]

    cdef Py_ssize_t highest(self, const double* local) noexcept:
        """Number of the first of the highest vertices of a mesh along a direction, in its axes."""
        cdef Py_ssize_t i, best = 0
        cdef double height, greatest = -INFINITY
        for i in range(self.count()):
            height = self.height(i, local)
            if height > greatest:
                best, greatest = i, height
        return best

    cdef void vertex(self, Py_ssize_t i, double* out) noexcept:
        """A vertex of a mesh, in its axes."""
        cdef int k
        for k in range(3):
            out[k] = self.vertices[i, k] if self._part is None else self.corners[i, k]

    cdef bytearray local_points(self, const double* local, double width, double tolerance, Py_ssize_t* count):
        """Extreme points along a direction, both in its axes, and how many; see :meth:`extreme`."""
        cdef double* size = <double*>self.size
        cdef double radial
        cdef double[4] ends
        cdef Py_ssize_t i, k, n = 1
        cdef bytearray block
        cdef double* out
        if self._kind == MESH:
            return self.level_vertices(local, width, count)
        block = room(6 * DISC)
        out = numbers(block)
        if self._kind == BOX:
            for k in range(3):
                out[k] = copysign(size[k], local[k])
            for k in range(3):
                if fabs(local[k]) <= width:
                    for i in range(3 * n):
                        out[3 * n + i] = -out[i] if i % 3 == k else out[i]
                    n *= 2
        elif self._kind == SPHERE or self._kind == PLANE:
            for k in range(3):
                out[k] = size[0] * local[k] if self._kind == SPHERE else 0.0
        elif self._kind == ELLIPSOID:
            for k in range(3):
                ends[k] = size[k] * local[k]
            radial = sqrt(dot(ends, ends))
            for k in range(3):
                out[k] = size[k] * size[k] * local[k] / radial
        else:
            ends[0], ends[1] = copysign(size[1], local[2]), size[1]
            n = 1
            if fabs(local[2]) <= width:
                ends[0], n = -size[1], 2
            if self._kind == CAPSULE:
                for i in range(n):
                    out[3 * i], out[3 * i + 1], out[3 * i + 2] = size[0] * local[0], size[0] * local[1], ends[i] + size[0] * local[2]
            else:
                n = self.rims(local, ends, n, width, tolerance, out)
        count[0] = n
        return block

    cdef Py_ssize_t rims(
        self, const double* local, const double* ends, Py_ssize_t n, double width, double tolerance, double* out
    ) noexcept:
        """Extreme points of a cylinder: the fixed points of a cap, or one point of a rim, or both ends of the side."""
        cdef double radius = self.size[0], radial = hypot(local[0], local[1]), angle
        cdef bint flat = radial <= width and lies_flat(radial, radius, tolerance)
        cdef Py_ssize_t i, k, around = DISC if flat else 1
        cdef double* point = out
        for i in range(n):
            for k in range(around):
                angle = 2.0 * _PI * k / DISC
                point[0] = radius * cos(angle) if flat else radius / radial * local[0]
                point[1] = radius * sin(angle) if flat else radius / radial * local[1]
                point[2] = ends[i]
                point += 3
        return n * around

    cdef bytearray level_vertices(self, const double* local, double width, Py_ssize_t* count):
        """Vertices of a mesh within an angle of the highest one along a direction, each once and sorted."""
        cdef double reach = 0.0, least
        cdef Py_ssize_t i, n = 0
        cdef bytearray block
        if width > 0.0:
            reach = (width if self._part is not None else max(width, _PRECISION)) * self.radius
        least = self.height(self.highest(local), local) - reach
        for i in range(self.count()):
            n += self.height(i, local) >= least
        block, count[0] = room(3 * n), n
        n = 0
        for i in range(self.count()):
            if self.height(i, local) >= least:
                self.vertex(i, numbers(block) + 3 * n)
                n += 1
        if n > 1 and self._part is None:  # those of a part are
            distinct = np.unique(np.frombuffer(block).reshape(n, 3), axis=0)
            block, count[0] = bytearray(distinct), len(distinct)
        return block

    cdef inline void to_world(self, const double* local, double* out) noexcept:
        """A point of its axes in those of the world."""
        cdef int k
        for k in range(3):
            out[k] = self.position[k] + dot(local, self.rotation + 3 * k)

    def extreme(self, const double[:] direction not None, double width=0.0, double tolerance=0.0):
        """All extreme points along a unit vector, (k, 3).

        Edges and faces within ``width`` rad of perpendicular to the vector count with all their corners, and caps of
        cylinders whose whole rim is level within CONTACT_GAP_M and a further ``tolerance`` in m. The origin of a plane
        stands for all of it.
        """
        return self.points_along(direction, width, tolerance, True)

    def local_extreme(self, const double[:] direction not None, double width):
        """The same points in its own axes: differences of them are not rounded with the distance from the origin."""
        return self.points_along(direction, width, 0.0, False)

    cdef points_along(self, const double[:] direction, double width, double tolerance, bint in_world):
        cdef double[3] along, local
        cdef Py_ssize_t i, count
        cdef bytearray block
        cdef double[:, ::1] points
        along[0], along[1], along[2] = direction[0], direction[1], direction[2]
        self.to_local(along, local)
        block = self.local_points(local, width, tolerance, &count)
        points = np.empty((count, 3))
        for i in range(count):
            if in_world:
                self.to_world(numbers(block) + 3 * i, &points[i, 0])
            else:
                points[i, 0], points[i, 1], points[i, 2] = numbers(block)[3 * i], numbers(block)[3 * i + 1], numbers(block)[3 * i + 2]
        return points.base

    cdef double support(self, const double* direction):
        """Greatest coordinate of its extreme points along a unit vector, m."""
        cdef double[3] local, point
        cdef Py_ssize_t i, count
        cdef double greatest = -INFINITY
        cdef bytearray block
        self.to_local(direction, local)
        if self._kind == MESH:  # of equal ones any will do
            self.vertex(self.highest(local), point)
            self.to_world(point, local)
            return dot(local, direction)
        block = self.local_points(local, 0.0, 0.0, &count)
        for i in range(count):
            self.to_world(numbers(block) + 3 * i, point)
            greatest = max(greatest, dot(point, direction))
        return greatest

    def extents(self, const double[:, :] directions not None):
        """Greatest coordinates of its points along unit vectors, (k, 3), m, (k,); that of a plane is along its normal."""
        cdef const double* size = self.size
        cdef double[::1] extents = np.empty(len(directions))
        cdef double[3] along, local
        cdef double extent
        cdef Py_ssize_t i, k
        for i in range(len(directions)):
            along[0], along[1], along[2] = directions[i, 0], directions[i, 1], directions[i, 2]
            self.to_local(along, local)
            if self._kind == SPHERE:
                extent = size[0]
            elif self._kind == ELLIPSOID:
                for k in range(3):
                    local[k] *= size[k]
                extent = sqrt(dot(local, local))
            elif self._kind == BOX:
                extent = fabs(local[0]) * size[0] + fabs(local[1]) * size[1] + fabs(local[2]) * size[2]
            elif self._kind == CAPSULE:
                extent = size[0] + size[1] * fabs(local[2])
            elif self._kind == CYLINDER:
                extent = size[0] * hypot(local[0], local[1]) + size[1] * fabs(local[2])
            elif self._kind == PLANE:
                extent = 0.0 if 1.0 - local[2] <= _EPSILON else INFINITY
            else:
                extent = self.height(self.highest(local), local)
            extents[i] = dot(along, self.position) + extent
        return extents.base

    cdef void place(self, const double[:] point, double* out) noexcept:
        """A point of world axes in its axes."""
        cdef double[3] offset
        cdef int i
        for i in range(3):
            offset[i] = point[i] - self.position[i]
        self.to_local(offset, out)

    def nearest(self, const double[:] point not None):
        """Outward unit normal where the surface of a round geom or box is nearest to a point, (3,), and its height, m.

        A capsule or sphere is a box without width, and a cylinder a box around its axis, each with a radius.
        """
        cdef const double* size = self.size
        cdef double[3] local, half
        cdef double[::1] normal = np.empty(3)
        cdef double radial, height, x, y
        cdef int i
        self.place(point, local)
        half[0], half[1], half[2] = 0.0, 0.0, 0.0
        if self._kind == CYLINDER:
            x, y, radial = local[0], local[1], hypot(local[0], local[1])
            local[0], local[1], half[0], half[1], half[2] = radial, 0.0, size[0], INFINITY, size[1]
            height = over_box(local, half)
            # On the axis all directions across it are equal.
            local[0], local[1] = (local[0] * x / radial, local[0] * y / radial) if radial > 0.0 else (local[0], 0.0)
        else:
            if self._kind == BOX:
                half[0], half[1], half[2] = size[0], size[1], size[2]
            elif self._kind == CAPSULE:
                half[2] = size[1]
            height = over_box(local, half)
            if self._kind != BOX:
                height -= size[0]
        for i in range(3):
            normal[i] = dot(local, self.rotation + 3 * i)
        return normal.base, height

    def normals_at(self, const double[:] point not None, double tolerance):
        """Outward unit normals of the surfaces of a box, plane or round geom that meet at a point, world axes, (k, 3).

        Args:
            point: A point, world axes, m, (3,).
            tolerance: A surface within this of the point, m, is at it.

        Returns:
            Empty if the point is within the geom; None if it is outside by more than the tolerance.
        """
        cdef const double* size = self.size
        cdef double[3] local, offset
        cdef double[18] normals
        cdef double[6] depths
        cdef double[:, ::1] there
        cdef double length, level
        cdef Py_ssize_t i, k, surfaces = 1, count = 0
        self.place(point, local)
        for i in range(18):
            normals[i] = 0.0
        for i in range(3):
            offset[i] = local[i]
        if self._kind == BOX:
            surfaces = 6
            for k in range(3):
                normals[4 * k], normals[9 + 4 * k] = 1.0, -1.0
                depths[k], depths[3 + k] = size[k] - local[k], size[k] + local[k]
        elif self._kind == PLANE:
            normals[2], depths[0] = 1.0, -local[2]
        elif self._kind == ELLIPSOID:
            # The height over an ellipsoid, to first order in it, is what counts next to its surface.
            for k in range(3):
                offset[k] /= size[k] * size[k]
            length, level = max(sqrt(dot(offset, offset)), _TINY), dot(local, offset)
            depths[0] = (1.0 - level) / (2.0 * length)
        else:
            if self._kind == CAPSULE:
                offset[2] -= min(max(local[2], -size[1]), size[1])
            elif self._kind == CYLINDER:
                surfaces, offset[2] = 3, 0.0
                normals[5], normals[8] = 1.0, -1.0
                depths[1], depths[2] = size[1] - local[2], size[1] + local[2]
            length = sqrt(dot(offset, offset))
            depths[0] = size[0] - length
        if self._kind != BOX and self._kind != PLANE:
            for k in range(3):
                normals[k] = offset[k] / max(length, _TINY)
        for i in range(surfaces):
            if depths[i] < -tolerance:
                return None
            count += depths[i] <= tolerance
        there, count = np.empty((count, 3)), 0
        for i in range(surfaces):
            if depths[i] <= tolerance:
                for k in range(3):
                    there[count, k] = dot(normals + 3 * i, self.rotation + 3 * k)
                count += 1
        return there.base


cdef double over_box(double* point, const double* half) noexcept:
    """Height of a point over a box, m: negative within it; its outward unit normal where it is nearest replaces the point."""
    cdef double[3] beyond
    cdef double height = 0.0, greatest = -INFINITY
    cdef int i, side = 0
    for i in range(3):
        beyond[i] = fabs(point[i]) - half[i]
        height += max(beyond[i], 0.0) ** 2
        if beyond[i] > greatest:
            greatest, side = beyond[i], i
    height = sqrt(height)
    for i in range(3):
        point[i] = copysign(max(beyond[i], 0.0) / height if height > 0.0 else 1.0 if i == side else 0.0, point[i])
    return height if height > 0.0 else greatest


def separation(PosedGeom first not None, PosedGeom second not None, const double[:] normal not None):
    """Separation along a direction, m: the signed gap if the direction is the normal."""
    cdef double[3] along, against
    cdef int i
    for i in range(3):
        along[i], against[i] = normal[i], -normal[i]
    return -second.support(against) - first.support(along)

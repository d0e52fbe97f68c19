# cython: boundscheck=False, wraparound=False, cdivision=True
"""External fields in the stages of a step: forces and torques on every body, and their work and impulses.

A field acts on bodies one by one: its force at the mass centre, its torque about it. Generalised forces follow from the sums
over what each degree of freedom moves, in MuJoCo's axes of motion about the mass centre of the whole tree. Work and
impulses are integrals over the stages of a step, by its own weights: their error is that of the step.
"""

import numpy as np

from libc.math cimport isfinite, NAN
from libc.string cimport memcmp, memcpy, memset

from ffsm_mj._core.functions cimport address, mjData


cdef class Bodies:
    """The moving bodies of a scene at an instant, as an external field sees them; n of them, in the order of the model.

    Attributes:
        names: Their names.
        mass_kg: Their masses, (n,).
        inertia_kg_m2: Principal moments of inertia about the mass centre, (n, 3).
        position_m: Positions of the mass centres in world axes, (n, 3).
        axes: Principal axes of inertia, columns in world axes, (n, 3, 3).
        velocity_m_s: Velocities of the mass centres in world axes, (n, 3).
        angular_velocity_rad_s: Angular velocities in world axes, (n, 3).
        force_N: To this a field adds the forces at the mass centres in world axes, (n, 3).
        torque_N_m: To this it adds the torques about the mass centres in world axes, (n, 3).
    """

    def __init__(self, names, masses, inertias):
        self.names, self.count = tuple(names), len(names)
        self.mass_kg, self.inertia_kg_m2 = np.array(masses, dtype=float), np.array(inertias, dtype=float).reshape(-1, 3)
        if len(self.mass_kg) != self.count or len(self.inertia_kg_m2) != self.count:
            raise ValueError(f"{self.count} names, {len(self.mass_kg)} masses and {len(self.inertia_kg_m2)} inertias")
        self.position_m, self.velocity_m_s, self.angular_velocity_rad_s = (np.zeros((self.count, 3)) for _ in range(3))
        self.axes = np.zeros((self.count, 3, 3))
        self.forces, self.torques = np.zeros((self.count, 3)), np.zeros((self.count, 3))
        self.mass, self.inertia, self.position = self.mass_kg, self.inertia_kg_m2, self.position_m
        self.turn, self.velocity = self.axes.reshape(-1, 9), self.velocity_m_s
        self.spin, self.force, self.torque = self.angular_velocity_rad_s, self.forces, self.torques
        self.control = np.zeros(0)

    @property
    def force_N(self):
        """Forces at the mass centres, (n, 3)."""
        return self.forces

    @force_N.setter
    def force_N(self, total):
        self.forces[...] = total  # as ``+=`` sets it

    @property
    def torque_N_m(self):
        """Torques about the mass centres, (n, 3)."""
        return self.torques

    @torque_N_m.setter
    def torque_N_m(self, total):
        self.torques[...] = total


cdef class CompiledField:
    """A field of the core. Its forces follow from time, poses and twists, and with ``by_controls`` from controls of actuators:
    at one state they are evaluated once."""

    cpdef int add_wrenches(self, double time_s, Bodies bodies) except -1:
        """Add forces and torques to those of the bodies."""
        raise NotImplementedError


cdef class UniformField(CompiledField):
    """The same acceleration of every body."""

    cdef double[3] acceleration

    def __init__(self, acceleration_m_s2):
        self.acceleration[0], self.acceleration[1], self.acceleration[2] = acceleration_m_s2

    cpdef int add_wrenches(self, double time_s, Bodies bodies) except -1:
        """Add mass times acceleration."""
        cdef Py_ssize_t k, i
        for k in range(bodies.count):
            for i in range(3):
                bodies.force[k, i] += bodies.mass[k] * self.acceleration[i]
        return 0


cdef class FieldForces:
    """Forces of external fields on the bodies of a motion.

    Attributes:
        bodies: The bodies with their forces and torques, as evaluated last.
        done: Work, and impulse (P, L about the world origin), in the last step by tree, J, N s and N m s, (trees, 7).
    """

    def __init__(self, model, data, ids, trees, Bodies bodies not None, fields, double[:, ::1] done not None):
        """Bind to a motion.

        Args:
            model: Model of the motion.
            data: Its data.
            ids: Ids of the bodies in this model, (n,).
            trees: Tree in the logged system of each, (n,).
            bodies: The bodies; values of this motion are written into it.
            fields: The fields.
            done: Receives work and impulses in a step, (trees, 7).
        """
        if not len(ids) == len(trees) == bodies.count or done.shape[1] != 7 or max(trees, default=-1) >= len(done):
            raise ValueError(f"{len(ids)} bodies in {len(trees)} trees do not fit")
        self.data, self.bodies, self.fields = data, bodies, tuple(fields)
        self.ids, self.trees = np.array(ids, dtype=np.intp), np.array(trees, dtype=np.intp)
        self.roots, self.parents = np.array(model.body_rootid[ids], dtype=np.intp), model.body_parentid
        self.dof_bodies = model.dof_bodyid
        self.total, self.sums = np.zeros((model.nbody, 6)), np.zeros_like(done)
        self.rates, self.generalised = np.zeros_like(done), np.zeros(model.nv)
        self.done, self.work = done.base, done
        # No state is the one evaluated last: NaN differs from every number.
        self.is_lasting = all(isinstance(field, CompiledField) for field in self.fields)
        self.last_qpos, self.last_qvel, self.last_s = np.full(model.nq, np.nan), np.full(model.nv, np.nan), NAN
        compiled = [field for field in self.fields if isinstance(field, CompiledField)]
        self.by_controls, self.last_control = any([(<CompiledField>one).by_controls for one in compiled]), np.zeros(model.nu)

    cpdef int push(self, data) except -1:
        """Add the generalised forces to ``data.qfrc_applied``; positions and velocities in ``data`` are current."""
        self.evaluate(data)
        self.add_generalised(&self.applied[0])
        if data is self.data and not self.is_rated:
            self.rate()
            self.is_rated = True
        return 0

    def add_to(self, data, double[::1] applied not None):
        """Add the generalised forces at the state in ``data``, derived quantities current, to an array, (nv,)."""
        if len(applied) != self.dof_bodies.shape[0]:
            raise ValueError(f"an array of {len(applied)} for {self.dof_bodies.shape[0]} degrees of freedom")
        self.evaluate(data)
        self.add_generalised(&applied[0])

    def evaluate_now(self):
        """Evaluate the forces and torques on the bodies at the state of the motion."""
        self.evaluate(self.data)

    cdef int bind(self, data) except -1:
        """Take views of the arrays in ``data``: each costs more than the sums over a few bodies."""
        self.bound, self.d = data, <const mjData*>address(data)
        self.centres, self.frames, self.twists = data.xipos, data.ximat, data.cvel
        self.subtree_centres, self.axes_of_dofs = data.subtree_com, data.cdof
        self.qpos, self.qvel, self.applied = data.qpos, data.qvel, data.qfrc_applied
        self.bodies.control = data.ctrl
        return 0

    cdef bint is_last(self, double now) noexcept:
        """Whether a state is the one evaluated last, bit by bit; that becomes it."""
        cdef size_t places = self.qpos.shape[0] * sizeof(double), rates = self.qvel.shape[0] * sizeof(double)
        cdef size_t controls = self.last_control.shape[0] * sizeof(double)
        # The end of a step is the start of the next one, and mostly the state of a row.
        if (
            self.is_lasting
            and now == self.last_s
            and memcmp(&self.qvel[0], &self.last_qvel[0], rates) == 0
            and memcmp(&self.qpos[0], &self.last_qpos[0], places) == 0
            and (not self.by_controls or memcmp(&self.bodies.control[0], &self.last_control[0], controls) == 0)
        ):
            return True
        if self.by_controls:
            memcpy(&self.last_control[0], &self.bodies.control[0], controls)
        memcpy(&self.last_qpos[0], &self.qpos[0], places)
        memcpy(&self.last_qvel[0], &self.qvel[0], rates)
        self.last_s = now
        return False

    cdef int evaluate(self, data) except -1:
        """Evaluate the forces and torques on the bodies, and the generalised forces, at the state in ``data``."""
        cdef Bodies bodies = self.bodies
        cdef double now
        if data is not self.bound:
            self.bind(data)
        now = self.d.time
        if self.is_last(now):
            return 0
        # A field that fails leaves nothing that counts as evaluated.
        self.last_s, self.is_rated = NAN, False
        self.see(bodies)
        for field in self.fields:
            if isinstance(field, CompiledField):
                (<CompiledField>field).add_wrenches(now, bodies)
            else:
                field.add_wrenches(now, bodies)
                self.refuse_numbers(field, now, bodies)
        self.generalise(bodies)
        self.last_s = now
        return 0

    cdef int refuse_numbers(self, field, double now, Bodies bodies) except -1:
        """Refuse forces and torques that are not finite, by the name of the field that gave them."""
        cdef Py_ssize_t k
        cdef int i
        cdef double place = 0.0, total
        for k in range(bodies.count):
            total = 0.0
            for i in range(3):
                place += bodies.position[k, i] + bodies.velocity[k, i] + bodies.spin[k, i]
                total += bodies.force[k, i] + bodies.torque[k, i]
            # Where the motion itself diverges, the run ends by its state.
            if not isfinite(total) and isfinite(place):
                raise ValueError(
                    f"external field {field.kind!r}: force {bodies.force_N[k]} N, torque {bodies.torque_N_m[k]} N m on "
                    f"{bodies.names[k]!r} at t = {now:.6g} s"
                )
        return 0

    cdef void see(self, Bodies bodies) noexcept:
        """Write poses and twists of the bodies, without forces."""
        cdef Py_ssize_t k, b, n = bodies.count
        cdef const double* c
        cdef const double* w
        cdef const double* p
        cdef const double* E
        cdef double* v
        cdef double x, y, z
        memset(&bodies.force[0, 0], 0, 3 * n * sizeof(double))
        memset(&bodies.torque[0, 0], 0, 3 * n * sizeof(double))
        for k in range(n):
            b = self.ids[k]
            p, w, E = &self.centres[b, 0], &self.twists[b, 0], &self.frames[b, 0]
            c, v = &self.subtree_centres[self.roots[k], 0], &bodies.velocity[k, 0]
            memcpy(&bodies.position[k, 0], p, 3 * sizeof(double))
            memcpy(&bodies.turn[k, 0], E, 9 * sizeof(double))
            memcpy(&bodies.spin[k, 0], w, 3 * sizeof(double))
            # MuJoCo's cvel is the velocity of the point at the tree's mass centre: moved to that of the body, at which a
            # field acts.
            x, y, z = p[0] - c[0], p[1] - c[1], p[2] - c[2]
            v[0] = w[3] + w[1] * z - w[2] * y
            v[1] = w[4] + w[2] * x - w[0] * z
            v[2] = w[5] + w[0] * y - w[1] * x

    cdef void generalise(self, Bodies bodies) noexcept:
        """Sum up forces and moments over what each degree of freedom moves."""
        cdef Py_ssize_t k, b, d, above
        cdef const double* c
        cdef const double* p
        cdef const double* f
        cdef const double* t
        cdef const double* along = &self.axes_of_dofs[0, 0]
        cdef const int* parents = &self.parents[0]
        cdef double* total = &self.total[0, 0]
        cdef double* whole
        cdef double x, y, z
        memset(total, 0, 6 * self.total.shape[0] * sizeof(double))
        for k in range(bodies.count):
            c, whole = &self.subtree_centres[self.roots[k], 0], total + 6 * self.ids[k]
            p, f, t = &bodies.position[k, 0], &bodies.force[k, 0], &bodies.torque[k, 0]
            x, y, z = p[0] - c[0], p[1] - c[1], p[2] - c[2]
            # The axes of the degrees of freedom (cdof) are about the mass centre of the tree, so the moments must be too.
            whole[0] = t[0] + y * f[2] - z * f[1]
            whole[1] = t[1] + z * f[0] - x * f[2]
            whole[2] = t[2] + x * f[1] - y * f[0]
            whole[3], whole[4], whole[5] = f[0], f[1], f[2]
        # Children have larger ids than their parents: one pass from the last body adds up what each joint carries.
        for b in range(self.total.shape[0] - 1, 0, -1):
            above = parents[b]
            # The world takes no force.
            if above > 0:
                add_six(total + 6 * above, total + 6 * b)
        for d in range(self.dof_bodies.shape[0]):
            whole = total + 6 * self.dof_bodies[d]
            self.generalised[d] = (
                along[0] * whole[0] + along[1] * whole[1] + along[2] * whole[2]
                + along[3] * whole[3] + along[4] * whole[4] + along[5] * whole[5]
            )
            along += 6

    cdef void add_generalised(self, double* applied) noexcept:
        """Add the generalised forces of what was evaluated last, (nv,)."""
        cdef Py_ssize_t d
        for d in range(self.generalised.shape[0]):
            applied[d] += self.generalised[d]

    cdef void rate(self) noexcept:
        """Write power, force and moment about the world origin by tree."""
        cdef Bodies bodies = self.bodies
        cdef Py_ssize_t k
        cdef double* rate
        cdef const double* f
        cdef const double* t
        cdef const double* p
        cdef const double* v
        cdef const double* w
        memset(&self.rates[0, 0], 0, 7 * self.rates.shape[0] * sizeof(double))
        for k in range(bodies.count):
            rate, f, t, p = &self.rates[self.trees[k], 0], &bodies.force[k, 0], &bodies.torque[k, 0], &bodies.position[k, 0]
            v, w = &bodies.velocity[k, 0], &bodies.spin[k, 0]
            rate[0] += f[0] * v[0] + f[1] * v[1] + f[2] * v[2] + t[0] * w[0] + t[1] * w[1] + t[2] * w[2]
            rate[1] += f[0]
            rate[2] += f[1]
            rate[3] += f[2]
            # About the world origin, as all angular momenta of the balance.
            rate[4] += t[0] + p[1] * f[2] - p[2] * f[1]
            rate[5] += t[1] + p[2] * f[0] - p[0] * f[2]
            rate[6] += t[2] + p[0] * f[1] - p[1] * f[0]

    cpdef int begin(self) except -1:
        """Begin the sum over the stages of a step."""
        memset(&self.sums[0, 0], 0, 7 * self.sums.shape[0] * sizeof(double))
        return 0

    cpdef int add(self, double weight) except -1:
        """Add a stage, whose forces were pushed last, with its weight."""
        cdef Py_ssize_t i
        cdef double* sums = &self.sums[0, 0]
        cdef const double* rates = &self.rates[0, 0]
        for i in range(7 * self.sums.shape[0]):
            sums[i] += weight * rates[i]
        return 0

    cpdef int end(self, double duration_s) except -1:
        """End a step of a duration, over which the weights add up to 1."""
        cdef Py_ssize_t i
        cdef double* work = &self.work[0, 0]
        cdef const double* sums = &self.sums[0, 0]
        for i in range(7 * self.sums.shape[0]):
            work[i] = duration_s * sums[i]
        return 0


cdef inline void add_six(double* total, const double* part) noexcept:
    total[0] += part[0]
    total[1] += part[1]
    total[2] += part[2]
    total[3] += part[3]
    total[4] += part[4]
    total[5] += part[5]

# cython: boundscheck=False, wraparound=False
"""Work of constant joint efforts over a step; twin of ffsm_mj.balance.joint_work."""


cdef class JointWork:
    """Accumulates the work of each (sub-)step."""

    cdef double[::1] held, length, force, account, start
    cdef const double[::1] on_joint, external
    cdef bint working

    def __init__(self, data, const double[::1] on_joint, const double[::1] external, double[::1] account not None):
        if not len(data.ctrl) == len(on_joint) == len(external) or len(account) == 0:
            raise ValueError(f"{len(on_joint)} and {len(external)} flags and an account of {len(account)} do not fit the actuators")
        self.held, self.length, self.force = data.ctrl, data.actuator_length, data.actuator_force
        self.on_joint, self.external, self.account = on_joint, external, account
        self.start = data.actuator_length.copy()
        self.working = False

    def open(self):
        """Begin a step; returns whether an effort in it is external."""
        cdef Py_ssize_t i
        cdef bint pushed = False
        self.working = False
        for i in range(self.held.shape[0]):
            self.start[i] = self.length[i]
            if self.held[i] != 0.0:
                self.working = True
                pushed = pushed or self.external[i] != 0.0
        return pushed

    def close(self):
        """End the step and add its work."""
        cdef Py_ssize_t i
        cdef double work = 0.0
        if self.working:
            for i in range(self.held.shape[0]):
                work += self.force[i] * self.on_joint[i] * (self.length[i] - self.start[i])
            self.account[0] += work

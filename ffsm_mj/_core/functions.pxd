# MuJoCo's C functions, by address: mj.step is mj_step. Model and data are opaque: of the layout of structs only the place of
# the time is built in, which each stage of a step sets.
# Every prototype is checked against mujoco.h at compile time (functions.h, which also has the names).

cdef extern from "mujoco/mujoco.h":
    ctypedef struct mjModel:
        pass
    ctypedef struct mjData:
        double time
    const int mjOBJ_SITE, mjOBJ_XBODY
    const int mjSTAGE_VEL  # positions and velocities are current, forces are not

cdef struct Functions:
    void (*step)(const mjModel* m, mjData* d) noexcept nogil
    void (*forward)(const mjModel* m, mjData* d) noexcept nogil
    void (*forwardSkip)(const mjModel* m, mjData* d, int skipstage, int skipsensor) noexcept nogil
    void (*RungeKutta)(const mjModel* m, mjData* d, int N) noexcept nogil
    void (*checkPos)(const mjModel* m, mjData* d) noexcept nogil
    void (*checkVel)(const mjModel* m, mjData* d) noexcept nogil
    void (*checkAcc)(const mjModel* m, mjData* d) noexcept nogil
    void (*getState)(const mjModel* m, const mjData* d, double* state, int sig) noexcept nogil
    void (*mulM)(const mjModel* m, const mjData* d, double* res, const double* vec) noexcept nogil
    void (*solveM)(const mjModel* m, mjData* d, double* x, const double* y, int n) noexcept nogil
    void (*jacSite)(const mjModel* m, const mjData* d, double* jacp, double* jacr, int site) noexcept nogil
    void (*jacBody)(const mjModel* m, const mjData* d, double* jacp, double* jacr, int body) noexcept nogil
    void (*jacDot)(const mjModel* m, const mjData* d, double* jacp, double* jacr, const double* point, int body) noexcept nogil
    void (*subtreeVel)(const mjModel* m, mjData* d) noexcept nogil
    void (*objectVelocity)(const mjModel* m, const mjData* d, int objtype, int objid, double* res, int flg_local) noexcept nogil
    void (*fwdPosition)(const mjModel* m, mjData* d) noexcept nogil
    void (*fwdVelocity)(const mjModel* m, mjData* d) noexcept nogil
    void (*fwdActuation)(const mjModel* m, mjData* d) noexcept nogil
    void (*collision)(const mjModel* m, mjData* d) noexcept nogil
    void (*integratePos)(const mjModel* m, double* qpos, const double* qvel, double dt) noexcept nogil

cdef Functions mj

cdef void* address(struct) except NULL

# MuJoCo's C functions, by address: model and data are opaque, so no header and no version of MuJoCo is built in.

cdef struct Functions:
    void (*step)(const void* m, void* d) noexcept nogil
    void (*forward)(const void* m, void* d) noexcept nogil
    void (*forward_skip)(const void* m, void* d, int stage, int skip_sensors) noexcept nogil
    void (*runge_kutta)(const void* m, void* d, int order) noexcept nogil
    void (*check_pos)(const void* m, void* d) noexcept nogil
    void (*check_vel)(const void* m, void* d) noexcept nogil
    void (*check_acc)(const void* m, void* d) noexcept nogil
    void (*get_state)(const void* m, const void* d, double* state, int what) noexcept nogil
    void (*mul_m)(const void* m, const void* d, double* result, const double* vector) noexcept nogil
    void (*solve_m)(const void* m, void* d, double* x, const double* y, int n) noexcept nogil
    void (*jac_site)(const void* m, const void* d, double* jacp, double* jacr, int site) noexcept nogil
    void (*jac_body)(const void* m, const void* d, double* jacp, double* jacr, int body) noexcept nogil
    void (*jac_dot)(const void* m, void* d, double* jacp, double* jacr, const double* point, int body) noexcept nogil
    void (*subtree_vel)(const void* m, void* d) noexcept nogil
    void (*object_velocity)(const void* m, const void* d, int kind, int id, double* twist, int local) noexcept nogil

cdef Functions mj

cdef void* address(struct) except NULL

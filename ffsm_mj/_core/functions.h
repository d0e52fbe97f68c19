/* Functions of MuJoCo that are called by address: their names, and their types, checked against mujoco.h. */

#include <mujoco/mujoco.h>

/* One name for each member of Functions in functions.pxd, without the prefix mj_. */
#define EACH(X) \
  X(step) X(forward) X(forwardSkip) X(RungeKutta) X(checkPos) X(checkVel) X(checkAcc) X(getState) X(mulM) \
  X(solveM) X(jacSite) X(jacBody) X(jacDot) X(subtreeVel) X(objectVelocity) X(fwdPosition) X(fwdVelocity) X(fwdActuation) \
  X(collision) X(integratePos)

#ifdef __clang__
#define COMPILER __VERSION__
#else
#define COMPILER "GCC " __VERSION__
#endif

#define NAMED(name) "mj_" #name,
static const char* const NAMES[] = {EACH(NAMED)};
#define COUNT (sizeof(NAMES) / sizeof(*NAMES))
static size_t ADDRESSES[COUNT];

/* A pointer whose type differs from that in mujoco.h does not compile. The function is only used in an unevaluated operand,
   so nothing is linked. */
#define TAKE(name) \
  _Static_assert(_Generic(&mj_##name, __typeof__(pointers->name): 1, default: 0), "mujoco.h declares mj_" #name " otherwise"); \
  pointers->name = (__typeof__(pointers->name))*address++;

/* Fill Functions with ADDRESSES, which are in the order of NAMES. */
#define TAKE_ALL(functions) do { \
  __typeof__(functions)* const pointers = &(functions); \
  const size_t* address = ADDRESSES; \
  _Static_assert(sizeof(functions) == sizeof(NAMES), "Functions has a member that functions.h does not name"); \
  EACH(TAKE) \
} while (0)

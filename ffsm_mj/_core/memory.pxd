# Memory for numbers of which Python sees arrays only where it asks for them: an array costs ten times as much to make.

from cpython.bytearray cimport PyByteArray_AS_STRING, PyByteArray_FromStringAndSize
from libc.string cimport memset


cdef inline bytearray room(Py_ssize_t count):
    """Memory for some numbers, not set. Ask for one more than needed where there may be none: no array of it is empty."""
    return PyByteArray_FromStringAndSize(NULL, count * <Py_ssize_t>sizeof(double))


cdef inline bytearray zeros(Py_ssize_t count):
    """Memory for some numbers, all zero."""
    cdef bytearray block = room(count)
    memset(PyByteArray_AS_STRING(block), 0, count * sizeof(double))
    return block


cdef inline double* numbers(bytearray block) noexcept:
    """The numbers in memory."""
    return <double*>PyByteArray_AS_STRING(block)

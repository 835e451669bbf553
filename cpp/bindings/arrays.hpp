// NumPy arrays in and out, shared by all bindings.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <algorithm>
#include <array>
#include <initializer_list>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "mechanism/mechanism.hpp"

namespace leastaction {

namespace nb = nanobind;

// An array of n axes that is only read. NumPy's contiguous arrays of doubles are taken by their array interface, which
// is quicker than nanobind's way for arrays that may not be written to. Nanobind takes all others, and converts them.
template <int n>
class In {
public:
    using Array = nb::ndarray<const double, nb::ndim<n>, nb::c_contig, nb::device::cpu>;

    In() = default;
    const double* data() const { return data_; }
    std::size_t ndim() const { return n; }
    std::size_t shape(std::size_t axis) const { return shape_[axis]; }
    std::size_t size() const {
        std::size_t size = 1;
        for (const std::size_t length : shape_) size *= length;
        return size;
    }

    bool take(nb::handle array) {
        // The struct of NumPy's array interface, of which the first entry is two.
        struct Interface {
            int two, axes;
            char kind;
            int item_size, flags;
            Py_ssize_t *shape, *strides;
            const void* data;
        };
        constexpr int in_rows = 0x1, aligned = 0x100, native = 0x200, needed = in_rows | aligned | native;
        static PyObject* const name = PyUnicode_InternFromString("__array_struct__");
        PyObject* capsule = PyObject_GetAttr(array.ptr(), name);
        const auto* of = capsule ? static_cast<const Interface*>(PyCapsule_GetPointer(capsule, nullptr)) : nullptr;
        const bool fits = of && of->two == 2 && of->axes == n && of->kind == 'f' && of->item_size == sizeof(double) &&
                          (of->flags & needed) == needed;
        if (fits) {
            std::copy_n(of->shape, n, shape_.begin());
            data_ = static_cast<const double*>(of->data);
            owner_ = nb::steal(capsule);
        } else {
            Py_XDECREF(capsule);
        }
        if (!of) PyErr_Clear();
        return fits;
    }
    void take(const Array& array) {
        array_ = array;
        data_ = array.data();
        for (int axis = 0; axis < n; ++axis) shape_[axis] = array.shape(axis);
    }

private:
    const double* data_ = nullptr;
    std::array<std::size_t, n> shape_{};
    nb::object owner_;  // this or the next keeps the numbers alive
    Array array_;
};
using Out = nb::ndarray<nb::numpy, double, nb::c_contig>;

// A new NumPy array that owns its memory; not initialised.
inline Out new_array(std::initializer_list<std::size_t> shape) {
    std::size_t size = 1;
    for (const std::size_t n : shape) size *= n;
    double* data = new double[std::max<std::size_t>(size, 1)];
    nb::capsule owner(data, [](void* p) noexcept { delete[] static_cast<double*>(p); });
    return Out(data, shape.size(), shape.begin(), owner);
}

inline Out zeros(std::initializer_list<std::size_t> shape) {
    Out out = new_array(shape);
    std::fill_n(out.data(), out.size(), 0.0);
    return out;
}

// The given array where it has the right shape (its contents are overwritten), else a new one: large results that are
// made again and again need not be mapped into memory each time.
inline Out reused(const std::optional<Out>& given, std::initializer_list<std::size_t> shape) {
    if (given && given->ndim() == shape.size() &&
        std::equal(shape.begin(), shape.end(), given->shape_ptr(),
                   [](std::size_t a, std::int64_t b) { return a == static_cast<std::size_t>(b); }))
        return *given;
    return new_array(shape);
}

inline Out copy_of(const std::vector<double>& values, std::initializer_list<std::size_t> shape) {
    Out out = new_array(shape);
    std::copy(values.begin(), values.end(), out.data());
    return out;
}

// A read-only field of a result that holds an array.
template <class Result>
void array_field(nb::class_<Result>& type, const char* name, Out Result::* field, const char* meaning) {
    type.def_prop_ro(name, [field](const Result& result) { return result.*field; }, nb::rv_policy::automatic, meaning);
}

// Length check with the name of the argument; shapes are checked in Python, this is the last fence before memory.
inline void expect(std::size_t got, std::size_t expected, const char* what) {
    if (got != expected)
        throw std::invalid_argument(std::string(what) + ": got length " + std::to_string(got) + ", expected " +
                                    std::to_string(expected));
}

// Mass, first moment and rotational inertia xx yy zz xy xz yz about an origin.
inline Inertia<double> inertia_of(const std::array<double, 10>& i) {
    return {i[0], {i[1], i[2], i[3]}, {i[4], i[5], i[6], i[7], i[8], i[9]}};
}

inline Vec3<double> vec3(const In<1>& a) {
    expect(a.size(), 3, "vector");
    return {a.data()[0], a.data()[1], a.data()[2]};
}
inline Body body_of(double mass, const In<1>& com, const In<2>& inertia) {
    expect(inertia.size(), 9, "inertia");
    const double* I = inertia.data();
    return {mass, vec3(com), {I[0], I[4], I[8], I[1], I[2], I[5]}};
}

// Between the user's order of variables and the internal one.
inline std::vector<double> to_internal(const Mechanism& m, const double* values) {
    std::vector<double> out(m.n_variables());
    for (std::size_t i = 0; i < out.size(); ++i) out[i] = values[m.external[i]];
    return out;
}
inline std::vector<double> to_internal(const Mechanism& m, const In<1>& values, const char* what) {
    expect(values.size(), m.n_variables(), what);
    return to_internal(m, values.data());
}

// A configuration in the user's order as an internal q: that of the variables, then the quaternions of balls.
inline void write_configuration(const Mechanism& m, const double* values, std::vector<double>& out) {
    out.resize(m.n_coordinates());
    for (int i = 0; i < m.n_variables(); ++i) out[i] = values[m.places[i]];
    for (const Ball& ball : m.balls) {
        std::fill_n(&out[ball.variable], 3, 0.0);
        std::copy_n(values + ball.place, 4, &out[ball.quaternion]);
    }
}
inline std::vector<double> configuration_of(const Mechanism& m, const double* values) {
    std::vector<double> out;
    write_configuration(m, values, out);
    return out;
}
inline std::vector<double> configuration_of(const Mechanism& m, const In<1>& values, const char* what) {
    expect(values.size(), m.n_configuration(), what);
    return configuration_of(m, values.data());
}

// Some of the entries of a list, those of the parts of one element, or all.
template <class List>
List some_of(const List& all, const std::optional<ElementParts>& parts, int ElementCounts::* kind) {
    if (!parts) return all;
    const int first = parts->first.*kind, last = parts->last.*kind;
    if (first < 0 || first > last || last > static_cast<int>(all.size()))
        throw std::invalid_argument("the element is none of this mechanism");
    return List(all.begin() + first, all.begin() + last);
}

}  // namespace leastaction

template <int n>
struct nanobind::detail::type_caster<leastaction::In<n>> {
    using General = make_caster<typename leastaction::In<n>::Array>;
    NB_TYPE_CASTER(leastaction::In<n>, General::Name)

    bool from_python(handle from, std::uint32_t flags, cleanup_list* cleanup) noexcept {
        if (from.is_none()) return false;
        if (value.take(from)) return true;
        General general;
        if (!general.from_python(from, flags, cleanup)) return false;
        value.take(general.value);
        return true;
    }
};

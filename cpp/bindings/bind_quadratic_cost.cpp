// Python access to quadratic costs; leastaction.optimal.discrete.cost says what the arguments mean.

#include <nanobind/nanobind.h>

#include <algorithm>
#include <tuple>

#include "arrays.hpp"
#include "optimal/quadratic_cost.hpp"

using namespace nanobind::literals;

namespace leastaction {
namespace {

using Wanted = nb::ndarray<const double, nb::device::cpu>;
using Weight = nb::ndarray<const double, nb::c_contig, nb::device::cpu>;
using Rows = nb::ndarray<double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using Row = nb::ndarray<double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

// What is wanted of states or inputs, (n,) or by rows, which may all be one in memory, and a weight of what they are off by:
// (n,), (n, n), (rows, n, 1) or (rows, n, n).
class Weighed {
public:
    Weighed(const Wanted& wanted, const Weight& weight, const char* what)
        : wanted_(wanted), weight_(weight), what_(what) {
        if (wanted.ndim() != 1 && wanted.ndim() != 2)
            throw std::invalid_argument(std::string(what) + ": axes of what is wanted");
        const bool same = wanted.ndim() == 1;
        n_ = wanted.shape(same ? 0 : 1);
        if (n_ > 1 && wanted.stride(same ? 0 : 1) != 1)
            throw std::invalid_argument(std::string(what) + ": what is wanted does not stand by rows");
        if (!same) {
            rows_ = wanted.shape(0);
            wanted_stride_ = static_cast<std::ptrdiff_t>(wanted.stride(0));
        }
        const bool by_rows = weight.ndim() == 3;
        diagonal_ = weight.ndim() == 1 || (by_rows && weight.shape(2) == 1);
        const std::size_t each = diagonal_ ? n_ : n_ * n_;
        if (by_rows) {
            rows_ = std::min(rows_, static_cast<std::size_t>(weight.shape(0)));
            weight_stride_ = static_cast<std::ptrdiff_t>(each);
        }
        expect(weight.size(), (by_rows ? weight.shape(0) : 1) * each, what);
    }

    // Calls with(off, weights) for rows of values, the first of which is `start` of the horizon.
    template <class With>
    void rows(const double* values, std::size_t n, std::size_t count, std::size_t start, const With& with) const {
        expect(n, n_, what_);
        if (start > rows_ || count > rows_ - start) throw std::invalid_argument(std::string(what_) + ": too many rows");
        const auto first = static_cast<std::ptrdiff_t>(start);
        with(Deviations{count, n_, values, wanted_.data() + first * wanted_stride_, wanted_stride_},
             RowWeights{weight_.data() + first * weight_stride_, diagonal_, weight_stride_});
    }
    std::size_t last() const { return wanted_stride_ || wanted_.ndim() == 2 ? wanted_.shape(0) - 1 : 0; }

private:
    Wanted wanted_;
    Weight weight_;
    const char* what_;
    std::size_t n_ = 0, rows_ = static_cast<std::size_t>(-1);
    std::ptrdiff_t wanted_stride_ = 0, weight_stride_ = 0;
    bool diagonal_ = true;
};

class QuadraticCost {
public:
    QuadraticCost(const Wanted& x_wanted, const Wanted& u_wanted, const Weight& Q, const Weight& R,
                  const Weight& Q_final)
        : x_(x_wanted, Q, "x"), u_(u_wanted, R, "u"), end_(x_wanted, Q_final, "x") {}

    void stages(const In<2>& x, const In<2>& u, std::size_t start, const Row& out) const {
        const std::size_t count = out.size();
        std::fill_n(out.data(), count, 0.0);
        for (const auto& [of, values] : {std::tie(x_, x), std::tie(u_, u)}) {
            if (values.shape(0) < count) throw std::invalid_argument("stages: fewer rows than stages");
            of.rows(
                values.data(), values.shape(1), count, start,
                [&](const Deviations& off, const RowWeights& weights) { add_half_squares(off, weights, out.data()); });
        }
    }
    double last(const In<1>& x) const {
        double value = 0.0;
        end_.rows(x.data(), x.size(), 1, end_.last(),
                  [&](const Deviations& off, const RowWeights& weights) { add_half_squares(off, weights, &value); });
        return value;
    }
    void gradient(const In<2>& x, const In<2>& u, const Rows& q, const Rows& r, const Row& q_final) const {
        const std::size_t N = u.shape(0), nx = x.shape(1);
        expect(x.shape(0), N + 1, "x");
        for (const auto& [of, values, out] : {std::tie(x_, x, q), std::tie(u_, u, r)}) {
            expect(out.shape(0), N, "a gradient");
            expect(out.shape(1), values.shape(1), "a gradient");
            of.rows(values.data(), values.shape(1), N, 0,
                    [&](const Deviations& off, const RowWeights& weights) { weigh_rows(off, weights, out.data()); });
        }
        expect(q_final.size(), nx, "q_final");
        end_.rows(x.data() + N * nx, nx, 1, end_.last(),
                  [&](const Deviations& off, const RowWeights& weights) { weigh_rows(off, weights, q_final.data()); });
    }

private:
    Weighed x_, u_, end_;
};

}  // namespace

void bind_quadratic_cost(nb::module_& m) {
    nb::class_<QuadraticCost>(m, "QuadraticCost", "Half the weighted squares of what states and inputs are off by.")
        .def(nb::init<const Wanted&, const Wanted&, const Weight&, const Weight&, const Weight&>(), "x_wanted"_a,
             "u_wanted"_a, "Q"_a, "R"_a, "Q_final"_a)
        .def("stages", &QuadraticCost::stages, "x"_a, "u"_a, "start"_a, "out"_a,
             "Writes those of as many stages as it has place for.")
        .def("last", &QuadraticCost::last, "x"_a, "That of the last state.")
        .def("gradient", &QuadraticCost::gradient, "x"_a, "u"_a, "q"_a, "r"_a, "q_final"_a,
             "Writes the derivatives of all stages, and of the last state.");
}

}  // namespace leastaction

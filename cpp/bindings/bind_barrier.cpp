// Python access to the barriers of limits; leastaction.optimal.limits.barrier says what the arguments mean.

#include <nanobind/nanobind.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/tuple.h>

#include <algorithm>
#include <vector>

#include "arrays.hpp"
#include "optimal/barrier.hpp"
#include "optimal/limit_prices.hpp"
#include "optimal/limit_rows.hpp"

using namespace nanobind::literals;

namespace leastaction {
namespace {

using Values = In<1>;
using Result = nb::ndarray<double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

template <class... Arrays>
Barrier barrier_of(double mu, const Values& rho, const Arrays&... others) {
    (expect(others.size(), rho.size(), "an array of values of limits"), ...);
    return {static_cast<std::ptrdiff_t>(rho.size()), mu, rho.data()};
}

void first_duals(const Values& barrier, const Values& rho, const Result& out) {
    barrier_of(0.0, rho, barrier, out);
    for (std::size_t i = 0; i < rho.size(); ++i) out.data()[i] = first_multiplier(barrier.data()[i], rho.data()[i]);
}

// The values of limits somewhere, and how they are split into slack and excess there.
class Room {
public:
    Room(const Values& c, double mu, const Values& rho) : Room(std::vector(c.data(), c.data() + c.size()), mu, rho) {}

    double value() const { return value_; }
    nb::ndarray<nb::numpy, const double> slack() const { return view(slack_); }
    nb::ndarray<nb::numpy, const double> excess() const { return view(excess_); }
    nb::ndarray<nb::numpy, const double> values() const { return view(c_); }

    void duals(const Result& out) const {
        with(out);
        for (std::size_t i = 0; i < slack_.size(); ++i) out.data()[i] = mu_ / slack_[i];
    }
    void stiffness(const Values& y, const Result& out) const {
        with(y, out).stiffness(slack_.data(), excess_.data(), y.data(), out.data());
    }
    double off_center(const Values& y) const { return with(y).off_center(slack_.data(), excess_.data(), y.data()); }
    void move_duals(const Values& y, const Values& dc, const Room& after, const Result& out) const {
        with(y, dc, out, after.rho_)
            .move_duals(slack_.data(), excess_.data(), y.data(), dc.data(), after.slack_.data(), out.data());
    }
    void keep_duals(const Values& y, const Result& out) const {
        const std::vector<double> still(y.size(), 0.0), excess(y.size(), 1.0);
        std::vector<double> slack(y.size());
        for (std::size_t i = 0; i < slack.size(); ++i) slack[i] = mu_ / y.data()[i];
        with(y, out).move_duals(slack.data(), excess.data(), y.data(), still.data(), slack_.data(), out.data());
    }
    void settle_duals(const Values& y, const Result& out) const {
        with(y, out);
        settle_multipliers(static_cast<std::ptrdiff_t>(y.size()), y.data(), slack_.data(), mu_, out.data());
    }
    double step(const Values& y, const Values& dc, double fall, double least, double length) const {
        return with(y, dc).step(c_.data(), slack_.data(), excess_.data(), y.data(), dc.data(), fall, least, length);
    }
    std::pair<double, double> along(const Values& y, const Values& dc) const {
        const auto found = with(y, dc).along(slack_.data(), excess_.data(), y.data(), dc.data());
        return {found.fall, found.stiff};
    }
    std::pair<Room, double> advance(const Values& y, const Values& dc, double fall, double bend,
                                    const Result& y_after) const {
        Room to = *this;
        const auto found = with(y, dc, y_after)
                               .advance({c_.data(), slack_.data(), excess_.data(), y.data()}, dc.data(), fall, bend,
                                        {to.c_.data(), to.slack_.data(), to.excess_.data(), y_after.data()});
        to.value_ = found.value;
        return {std::move(to), found.length};
    }

private:
    Room(std::vector<double> c, double mu, const Values& rho)
        : c_(std::move(c)), slack_(c_.size()), excess_(c_.size()), mu_(mu), rho_(rho) {
        expect(rho.size(), c_.size(), "prices of limits");
        value_ = with().split(c_.data(), slack_.data(), excess_.data());
    }
    template <class... Arrays>
    Barrier with(const Arrays&... others) const {
        return barrier_of(mu_, rho_, others...);
    }
    static nb::ndarray<nb::numpy, const double> view(const std::vector<double>& of) {
        const std::size_t size = of.size();
        return {of.data(), 1, &size, nb::handle()};
    }

    std::vector<double> c_, slack_, excess_;
    double mu_, value_ = 0.0;
    Values rho_;
};

using Places = nb::ndarray<const std::int64_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

void within(const Places& some, std::size_t end, const char* what) {
    for (std::size_t i = 0; i < some.shape(0); ++i)
        if (some.data()[i] < 0 || some.data()[i] >= static_cast<std::int64_t>(end))
            throw std::invalid_argument(std::string(what) + ": no such place: " + std::to_string(some.data()[i]));
}

using Flags = nb::ndarray<const bool, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

std::tuple<bool, double, double> price(const Places& column, const Places& other, const Flags& equal, const Flags& hard,
                                       const Values& dear, const Values& scale, double dearest, double met, double kept,
                                       const Values& c, const Result& rho, const Result& y, const Result& prices) {
    const std::size_t entries = column.size(), columns = rho.size();
    for (const std::size_t size : {other.size(), c.size(), y.size(), prices.size()})
        expect(size, entries, "of entries");
    for (const std::size_t size : {equal.size(), hard.size(), dear.size(), scale.size()})
        expect(size, columns, "of columns");
    within(column, columns, "column");
    within(other, entries, "other");
    const LimitColumns limits{static_cast<std::ptrdiff_t>(entries),
                              static_cast<std::ptrdiff_t>(columns),
                              column.data(),
                              other.data(),
                              equal.data(),
                              hard.data(),
                              dear.data(),
                              scale.data()};
    const Priced found = price_limits(limits, {dearest, met, kept}, c.data(), rho.data(), y.data(), prices.data());
    return {found.dearer, found.dearest, found.cheapest};
}

bool unenforced(const Places& other, const Values& y, const Values& prices) {
    const std::size_t entries = y.size();
    for (const std::size_t size : {other.size(), prices.size()}) expect(size, entries, "of entries");
    within(other, entries, "other");
    return some_unenforced(static_cast<std::ptrdiff_t>(entries), other.data(), y.data(), prices.data());
}

double largest_product(const Places& column, const Values& y, const Values& scale) {
    expect(column.size(), y.size(), "of entries");
    within(column, scale.size(), "column");
    double largest = 0.0;
    for (std::size_t e = 0; e < y.size(); ++e)
        largest = std::max(largest, y.data()[e] * scale.data()[column.data()[e]]);
    return largest;
}

using NewFlags = nb::ndarray<bool, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

void active(const Places& column, const Values& scale, const Values& y, double least, double hardly,
            const NewFlags& out) {
    for (const std::size_t size : {column.size(), out.size()}) expect(size, y.size(), "of entries");
    within(column, scale.size(), "column");
    find_active(static_cast<std::ptrdiff_t>(y.size()), static_cast<std::ptrdiff_t>(scale.size()), column.data(),
                scale.data(), y.data(), least, hardly, out.data());
}

using Rows = nb::ndarray<double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;

// Limits that are entries of states or inputs, times factors: where each is in these, and where among all limits.
class EntryRows {
public:
    EntryRows(const Places& places, const Values& factors, const Values& bounds, const Places& at) {
        for (const std::size_t count : {factors.size(), bounds.size(), at.size()})
            expect(count, places.size(), "of entries");
        for (std::size_t i = 0; i < places.size(); ++i) {
            const std::int64_t place = places.data()[i], where = at.data()[i];
            if (place < 0 || where < 0) throw std::invalid_argument("no such entry");
            all_.push_back({static_cast<std::size_t>(place), static_cast<std::size_t>(where), factors.data()[i],
                            bounds.data()[i]});
            size_ = std::max(size_, all_.back().place + 1);
            limits_ = std::max(limits_, all_.back().at + 1);
        }
    }
    void values(const In<2>& z, const Result& out) const {
        check(z.size(), out.size());
        for (const Entry& e : all_) out.data()[e.at] = e.factor * z.data()[e.place] - e.bound;
    }
    void along(const In<2>& dz, const Result& out) const {
        check(dz.size(), out.size());
        for (const Entry& e : all_) out.data()[e.at] = e.factor * dz.data()[e.place];
    }
    void pull(const In<2>& gradient, const Values& y, const Rows& out) const {
        expect(gradient.size(), out.size(), "the gradient");
        check(out.size(), y.size());
        std::copy_n(gradient.data(), out.size(), out.data());
        for (const Entry& e : all_) out.data()[e.place] -= e.factor * y.data()[e.at];
    }
    void weigh(const Values& sigma, const Rows& out) const {
        check(out.size(), sigma.size());
        std::fill_n(out.data(), out.size(), 0.0);
        for (const Entry& e : all_) out.data()[e.place] += e.factor * e.factor * sigma.data()[e.at];
    }

private:
    struct Entry {
        std::size_t place, at;
        double factor, bound;
    };
    void check(std::size_t size, std::size_t limits) const {
        if (size < size_ || limits < limits_) throw std::invalid_argument("too few states, inputs or limits");
    }
    std::vector<Entry> all_;
    std::size_t size_ = 0, limits_ = 0;  // what they need at least
};

using Matrices = nb::ndarray<double, nb::ndim<3>, nb::c_contig, nb::device::cpu>;

void add_rows(const In<3>& J, const In<2>& sigma, const std::optional<In<3>>& bent, const Places& k,
              const Places& places, const Matrices& to) {
    const std::size_t n = J.shape(0), rows = J.shape(1), c = J.shape(2), width = to.shape(2);
    expect(sigma.shape(0), n, "sigma");
    expect(sigma.shape(1), rows, "sigma");
    expect(k.shape(0), n, "k");
    expect(places.shape(0), c, "places");
    expect(to.shape(1), width, "to");
    if (bent) {
        expect(bent->shape(0), n, "bent");
        for (const std::size_t i : {1, 2}) expect(bent->shape(i), c, "bent");
    }
    within(k, to.shape(0), "k");
    within(places, width, "places");
    LimitRows limits(rows, std::vector<std::size_t>(places.data(), places.data() + c), width);
    for (std::size_t i = 0; i < n; ++i)
        limits.add(J.data() + i * rows * c, sigma.data() + i * rows, bent ? bent->data() + i * c * c : nullptr,
                   to.data() + static_cast<std::size_t>(k.data()[i]) * width * width);
}

}  // namespace

void bind_barrier(nb::module_& m) {
    const auto here = nb::rv_policy::reference_internal;
    nb::class_<Room>(m, "Room", "The values of limits somewhere, split into slack and excess: c = slack - excess.")
        .def(nb::init<const Values&, double, const Values&>(), "c"_a, "mu"_a, "rho"_a)
        .def_prop_ro("value", &Room::value, "The sum of the barriers.")
        .def_prop_ro("c", &Room::values, here)
        .def_prop_ro("slack", &Room::slack, here)
        .def_prop_ro("excess", &Room::excess, here)
        .def("duals", &Room::duals, "out"_a, "Writes the duals of the barriers.")
        .def("stiffness", &Room::stiffness, "y"_a, "out"_a, "Writes -dy/dc of the primal-dual model.")
        .def("off_center", &Room::off_center, "y"_a,
             "The largest product of a dual and its slack, or of what its price has left and its excess.")
        .def("move_duals", &Room::move_duals, "y"_a, "dc"_a, "after"_a, "out"_a, "Writes duals after a step along dc.")
        .def("keep_duals", &Room::keep_duals, "y"_a, "out"_a, "Writes duals that are near those of the barriers.")
        .def("settle_duals", &Room::settle_duals, "y"_a, "out"_a,
             "Writes duals, or those of the barrier where they have not come near them.")
        .def("step", &Room::step, "y"_a, "dc"_a, "fall"_a, "least"_a, "length"_a,
             "Where along a direction the model with the barriers themselves is least.")
        .def("along", &Room::along, "y"_a, "dc"_a,
             "How the barriers fall along a direction, and the stiffness along it.")
        .def("advance", &Room::advance, "y"_a, "dc"_a, "fall"_a, "bend"_a, "y_after"_a,
             "The room where that model is least, and how far that is; writes the duals there.");
    m.def("barrier_first_duals", &first_duals, "barrier"_a, "rho"_a, "out"_a,
          "Writes duals to begin with, given those of the barrier.");
    m.def(
        "price_limits", &price, "column"_a, "other"_a, "equal"_a, "hard"_a, "dear"_a, "scale"_a, "dearest"_a, "met"_a,
        "kept"_a, "c"_a, "rho"_a, "y"_a, "prices"_a,
        "Changes the prices of columns and the duals of entries, and writes the prices of these; returns whether some "
        "limit needs a higher price, and the highest and the lowest of an excess of its scale.");
    m.def("some_unenforced", &unenforced, "other"_a, "y"_a, "prices"_a,
          "Whether the price of some entry does not enforce its limit.");
    m.def("largest_product", &largest_product, "column"_a, "y"_a, "scale"_a,
          "The largest product of an entry and the scale of its column; 0 where none is positive.");
    m.def("active_limits", &active, "column"_a, "scale"_a, "y"_a, "least"_a, "hardly"_a, "out"_a,
          "Writes which entries hold the motion back.");
    nb::class_<EntryRows>(m, "EntryRows", "Limits that are entries of states or inputs, times factors.")
        .def(nb::init<const Places&, const Values&, const Values&, const Places&>(), "places"_a, "factors"_a,
             "bounds"_a, "at"_a)
        .def("values", &EntryRows::values, "z"_a, "out"_a, "Writes their values to where they are among limits.")
        .def("along", &EntryRows::along, "dz"_a, "out"_a, "Writes the changes of these along a direction.")
        .def("pull", &EntryRows::pull, "gradient"_a, "y"_a, "out"_a,
             "Writes a gradient by states or inputs less duals times derivatives.")
        .def("weigh", &EntryRows::weigh, "sigma"_a, "out"_a, "Writes the diagonals of their stiffness.");
    m.def("add_limit_rows", &add_rows, "jacobian"_a, "sigma"_a, "bent"_a.none(), "k"_a, "places"_a, "to"_a,
          "Adds J' sigma J - bent of every one of n stages at some places of matrices of stages k.");
}

}  // namespace leastaction

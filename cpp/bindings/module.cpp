// The extension module: calls every bind_*.cpp. LEASTACTION_MODULE is the variant's name.

#include <nanobind/nanobind.h>

namespace leastaction {
void bind_builder(nanobind::module_&);
void bind_mechanism(nanobind::module_&);
void bind_midpoint(nanobind::module_&);
void bind_linear_quadratic(nanobind::module_&);
void bind_quadratic_cost(nanobind::module_&);
void bind_barrier(nanobind::module_&);
void bind_tape(nanobind::module_&);
void bind_continuous(nanobind::module_&);
}  // namespace leastaction

NB_MODULE(LEASTACTION_MODULE, m) {
    // A mechanism may hold a function of the user's whose module holds the mechanism: a circle that the garbage collector
    // does not see, and nothing to warn of at exit.
    nanobind::set_leak_warnings(false);
    m.doc() = "The numerical core of leastaction.";
    leastaction::bind_tape(m);
    leastaction::bind_mechanism(m);
    leastaction::bind_builder(m);
    leastaction::bind_midpoint(m);
    leastaction::bind_continuous(m);
    leastaction::bind_linear_quadratic(m);
    leastaction::bind_quadratic_cost(m);
    leastaction::bind_barrier(m);
}

// The extension module: calls every bind_*.cpp. LEASTACTION_MODULE is the variant's name.

#include <nanobind/nanobind.h>

namespace leastaction {
void bind_mechanism(nanobind::module_&);
void bind_midpoint(nanobind::module_&);
void bind_linear_quadratic(nanobind::module_&);
}  // namespace leastaction

NB_MODULE(LEASTACTION_MODULE, m) {
    m.doc() = "The numerical core of leastaction.";
    leastaction::bind_mechanism(m);
    leastaction::bind_midpoint(m);
    leastaction::bind_linear_quadratic(m);
}

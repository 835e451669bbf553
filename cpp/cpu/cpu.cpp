// Which of the compiled variants of the core this CPU (and its operating system) can run.
// Compiled for the plain platform: it runs before the choice is made.

#include <string_view>

#include <nanobind/nanobind.h>

namespace nb = nanobind;

namespace {

bool supports_v3() {
#if defined(__x86_64__) && defined(__GNUC__)
    __builtin_cpu_init();
    return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") && __builtin_cpu_supports("bmi") &&
           __builtin_cpu_supports("bmi2");
#else
    return false;
#endif
}

bool supports_v4() {
#if defined(__x86_64__) && defined(__GNUC__)
    return supports_v3() && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
           __builtin_cpu_supports("avx512cd") && __builtin_cpu_supports("avx512dq") &&
           __builtin_cpu_supports("avx512vl");
#else
    return false;
#endif
}

}  // namespace

NB_MODULE(LEASTACTION_MODULE, m) {
    m.doc() = "What this CPU can run.";
    m.def(
        "supports",
        [](const char* variant) {
            const std::string_view name(variant);
            return name == "baseline" || (name == "v3" && supports_v3()) || (name == "v4" && supports_v4());
        },
        nb::arg("variant"), "Whether this CPU can run the named variant of the core.");
}

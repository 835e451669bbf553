#include "kinematics/support_joints.hpp"

#include <algorithm>
#include <iterator>
#include <unordered_map>

namespace leastaction {

bool is_above(const std::vector<Joint>& joints, int ancestor, int joint) {
    for (; joint >= 0; joint = joints[joint].parent)
        if (joint == ancestor) return true;
    return false;
}

std::vector<int> joints_above(const std::vector<Joint>& joints, int joint) {
    std::vector<int> out;
    for (; joint >= 0; joint = joints[joint].parent) out.push_back(joint);
    std::sort(out.begin(), out.end());
    return out;
}

std::vector<int> either(const std::vector<int>& a, const std::vector<int>& b) {
    std::vector<int> out;
    std::set_union(a.begin(), a.end(), b.begin(), b.end(), std::back_inserter(out));
    return out;
}

std::vector<int> only_one(const std::vector<int>& a, const std::vector<int>& b) {
    std::vector<int> out;
    std::set_symmetric_difference(a.begin(), a.end(), b.begin(), b.end(), std::back_inserter(out));
    return out;
}

SupportJoints::SupportJoints(const std::vector<Joint>& joints, std::vector<int> moving, std::vector<int> extra)
    : joints_(std::move(moving)), n_extra_(extra.size()) {
    const std::size_t n = joints_.size();
    std::unordered_map<int, int> index_of;  // of a variable in the support
    const auto add_term = [&](int variable, double factor) {
        const auto [found, is_new] = index_of.try_emplace(variable, static_cast<int>(support_.size()));
        const int index = found->second;
        if (is_new)
            support_.push_back(variable);
        else
            plain_ = false;
        plain_ = plain_ && factor == 1.0 && index == static_cast<int>(terms_.size()) - 1;
        terms_.back().push_back({index, factor});
    };
    for (const int joint : joints_) {
        terms_.emplace_back();
        joints[joint].each_term(add_term);
    }
    for (const int variable : extra) {
        terms_.emplace_back();
        add_term(variable, 1.0);
    }
    // What is above a joint is above all that hang on it, and joints come after their parents.
    above_.resize(n * n);
    for (std::size_t i = 0; i < n; ++i) {
        const auto before = joints_.begin() + i;
        for (int parent = joints[joints_[i]].parent; parent >= 0; parent = joints[parent].parent) {
            const auto at = std::lower_bound(joints_.begin(), before, parent);
            if (at == before || *at != parent) continue;
            std::copy_n(&above_[(at - joints_.begin()) * n], n, &above_[i * n]);
            break;
        }
        above_[i * n + i] = 1;
    }
}

template <class T>
void SupportJoints::fold_terms(Order order, LocalTaylor<T>& out) const {
    const std::size_t n = terms_.size(), m = support_.size();
    out.by_joint.swap(out.gradient);
    out.gradient.assign(m, T{});
    for (std::size_t i = 0; i < n; ++i)
        for (const Term& a : terms_[i]) out.gradient[a.variable] += a.factor * out.by_joint[i];
    if (order == Order::gradient) return;
    out.by_joint.swap(out.hessian);
    out.hessian.assign(m * m, T{});
    for (std::size_t i = 0; i < n; ++i)
        for (std::size_t j = 0; j < n; ++j)
            for (const Term& a : terms_[i])
                for (const Term& b : terms_[j])
                    out.hessian[a.variable * m + b.variable] += (a.factor * b.factor) * out.by_joint[i * n + j];
}

template void SupportJoints::fold_terms(Order, LocalTaylor<double>&) const;
template void SupportJoints::fold_terms(Order, LocalTaylor<Dual<double>>&) const;
template void SupportJoints::fold_terms(Order, LocalTaylor<HyperDual>&) const;
template void SupportJoints::fold_terms(Order, LocalTaylor<Lanes>&) const;

}  // namespace leastaction

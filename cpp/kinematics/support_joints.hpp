// The joints that move an element, and the step from derivatives by joint coordinates to derivatives by variables.
//
// For a point p (or a vector e fixed in a frame) behind joint k and a joint i on the path to k, z_i = v_i + w_i x p (or
// w_i x e), and for j an ancestor of i or i itself z_ij = w_j x z_i.
#pragma once

#include "kinematics/points.hpp"
#include "numerics/taylor.hpp"

namespace leastaction {

// Whether `ancestor` is the joint or stands above it.
bool is_above(const std::vector<Joint>& joints, int ancestor, int joint);

class SupportJoints {
public:
    // The given joints, ascending, with the variables that they turn on; `extra` variables stand for themselves and come
    // after the joints.
    SupportJoints(const std::vector<Joint>& joints, std::vector<int> moving, std::vector<int> extra = {});

    int count() const { return static_cast<int>(joints_.size()); }
    int size() const { return count() + static_cast<int>(n_extra_); }  // of the derivatives before folding
    int joint(int i) const { return joints_[i]; }
    bool above(int j, int i) const { return above_[i * joints_.size() + j]; }  // joint j is joint i or stands above it
    const std::vector<int>& joints() const { return joints_; }
    const std::vector<int>& support() const { return support_; }

    // Turns gradient and Hessian by joint coordinates (and extra variables) into those by the variables of the support.
    template <class T>
    void fold(Order order, LocalTaylor<T>& out) const {
        if (!plain_ && order != Order::value) fold_terms(order, out);
    }
    bool plain() const { return plain_; }
    // The same for one row or column: calls f(index in the support, factor) for the terms of a joint.
    const std::vector<Term>& terms(int i) const { return terms_[i]; }

private:
    template <class T>
    void fold_terms(Order order, LocalTaylor<T>& out) const;

    std::vector<int> joints_, support_;
    std::size_t n_extra_;
    std::vector<char> above_;
    std::vector<std::vector<Term>> terms_;  // by joint: index in the support, factor
    bool plain_ = true;                     // every joint has one variable, of its own, with the factor 1
};

// All joints above a place, ascending.
std::vector<int> joints_above(const std::vector<Joint>& joints, int joint);
// The union of two ascending lists; what is in one of them only.
std::vector<int> either(const std::vector<int>& a, const std::vector<int>& b);
std::vector<int> only_one(const std::vector<int>& a, const std::vector<int>& b);

}  // namespace leastaction

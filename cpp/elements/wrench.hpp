// A force and a torque on a frame. Torques are no derivatives of a coordinate, so wrenches stand on their own.
//
// As a spatial force Phi = [f; n] about the world origin, f_i = Phi.S_i. With the wrench [F; T]:
//   spatial   Phi = [F; T]               world axes, about the world origin
//   body      Phi = [R F; R T + p x R F] axes and origin of the frame
//   hybrid    Phi = [F; T + p x F]       world axes, at the origin of the frame
// The joints of the path stand in a row, j before i meaning j above i, and dS_i/dq_j = S_j x S_i for j before i, else 0.
#pragma once

#include <array>

#include "elements/elements.hpp"
#include "kinematics/support_joints.hpp"

namespace leastaction {

class Wrench final : public ForceOnAnyScalar<Wrench> {
public:
    enum class Kind { spatial, body, hybrid };

    // `point` is the frame's origin, `axes` three directions. Each component is a number (its slot), an input, or their
    // product (-1: no).
    Wrench(const Constants& constants, Kind kind, int joint, int point, const std::array<int, 3>& axes,
           const std::array<int, 6>& slots, const std::array<int, 6>& inputs);

    void curvature(const ForcePoint<double>& point, const ForceDirections& directions,
                   LocalForce<double>& out) const override;

    template <class T>
    void evaluate_on(const ForcePoint<T>& point, Order order, LocalForce<T>& out) const;

private:
    // Phi of the wrench with the given components; hybrid moments about the frame's own origin are kept apart.
    template <class T>
    Force<T> about_origin(const Placement<T>& at, const T* components) const;
    template <class T>
    T gain(const Placement<T>& at, int c) const;
    template <class T>
    void components(const ForcePoint<T>& point, T* out) const;
    template <class T>
    void add_force(const Placement<T>& at, const T* components, std::vector<T>& f) const;
    void second_by_place(const Placement<double>& at, const double* components, const std::vector<double>& mu,
                         std::vector<double>& P) const;
    // Derivative of mu.f by each joint.
    void first_by_place(const Placement<double>& at, const double* components, const std::vector<double>& mu,
                        std::vector<double>& P) const;
    template <class T>
    T slope(const Placement<T>& at, const Force<T>& phi, const Vec3<T>& F, int i, int j) const;

    Kind kind_;
    SupportJoints support_joints_;
    int point_;
    std::array<int, 3> axes_;
    std::array<int, 6> slots_, local_inputs_;
};

}  // namespace leastaction

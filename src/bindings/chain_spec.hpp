#pragma once
// A chain of any size, as the module's classes share it.

#include "engine/any_chain.hpp"
#include "module.hpp"

namespace tenodesis::bindings {

using engine::AnyChain, engine::most_joints, engine::most_tendons;
/// Numbers of a joint, in this order.
enum JointNumber {
  axis_x,
  axis_y,
  axis_z,
  offset,
  chord,
  length,
  stiffness,
  hardening,
  tied_to,
  tie_ratio,
  tie_stiffness,
  tie_is_rigid,
  share,
  grip,
  bends_within,
  joint_numbers
};

class ChainSpec {
 public:
  ChainSpec(const std::vector<int>& mechanism, const std::vector<int>& parent, const In<2>& numbers, const In<2>& arm,
            const In<2>& tendon, const std::vector<int>& motor, const std::vector<int>& handle, const In<2>& handle_arm,
            const In<3>& growth);

  const AnyChain& any() const { return any_; }
  std::size_t joints() const { return joints_; }
  std::size_t tendons() const { return tendons_; }
  std::size_t handles() const { return handles_; }

 private:
  void make();

  std::size_t joints_, tendons_, handles_;
  AnyChain any_;
};

}  // namespace tenodesis::bindings

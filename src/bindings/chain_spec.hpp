#pragma once
// A chain of any size, as the module's classes share it.

#include <variant>

#include "engine/chain_rows.hpp"
#include "module.hpp"
#include "tenodesis/tendon_chain.hpp"

namespace tenodesis::bindings {

using engine::most_joints, engine::most_tendons;
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

template <int N>
using Paired = TendonChain<double, N, 2 * N>;
template <int N>
using Many = TendonChain<double, N, int(most_tendons)>;
// A chain of a number of joints that is not built has the next larger one, whose further joints are inert. Most chains
// have two tendons a joint or fewer; their loops are short.
using Any = std::variant<Paired<1>, Many<1>, Paired<2>, Many<2>, Paired<3>, Many<3>, Paired<4>, Many<4>, Paired<5>,
                         Many<5>, Many<6>, Many<7>, Many<8>, Many<12>, Many<16>, Many<int(most_joints)>>;

class ChainSpec {
 public:
  ChainSpec(const std::vector<int>& mechanism, const std::vector<int>& parent, const In<2>& numbers, const In<2>& arm,
            const In<2>& tendon, const std::vector<int>& motor, const std::vector<int>& handle, const In<2>& handle_arm,
            const In<3>& growth);

  const Any& any() const { return any_; }
  std::size_t joints() const { return joints_; }
  std::size_t tendons() const { return tendons_; }
  std::size_t handles() const { return handles_; }

 private:
  void make();

  std::size_t joints_, tendons_, handles_;
  Any any_;
};

}  // namespace tenodesis::bindings

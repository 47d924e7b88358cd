// Included once by each file that is compiled for a kind of processor, which sets TENODESIS_LANES and
// TENODESIS_PROCESSOR first.

#include <new>

#include "lane_twins.hpp"
#include "tenodesis/packed_dual.hpp"
#include "twin_gradient.hpp"
#include "twin_spec.hpp"

// Each file that includes this has a namespace of its own.
// NOLINTBEGIN(misc-anonymous-namespace-in-header,misc-definitions-in-headers)
namespace tenodesis::engine {
namespace {

// A group with its kind, which says what it is.
template <int axes, Mechanism tip>
struct Group {
  tenodesis_lanes::Kind kind;
  LaneTwins<axes, tip, TENODESIS_LANES> twins;
};

template <class Work>
void with_kind(const tenodesis_lanes::Kind& kind, const Work& work) {
  const auto with_axes = [&]<int axes>() {
    switch (Mechanism(kind.mechanism)) {
      case Mechanism::gear:
        return work.template operator()<Group<axes, Mechanism::gear>>();
      case Mechanism::pulley:
        return work.template operator()<Group<axes, Mechanism::pulley>>();
      case Mechanism::continuum:
        return work.template operator()<Group<axes, Mechanism::continuum>>();
    }
  };
  if (kind.axes == 1) return with_axes.template operator()<1>();
  with_axes.template operator()<2>();
}

// The first member of each is its kind.
template <class Work>
void with_group(const void* group, const Work& work) {
  with_kind(*static_cast<const tenodesis_lanes::Kind*>(group), work);
}

void* make_group(const tenodesis_lanes::Kind& kind) {
  void* made{};
  with_kind(kind, [&]<class G>() { made = new G{kind, decltype(G::twins)(kind)}; });
  return made;
}

void start(void* group, int lane, const void* twin, const void* state) {
  with_group(group, [&]<class G>() { static_cast<G*>(group)->twins.start(lane, twin, state); });
}

void advance(void* group, const tenodesis_lanes::Job& job) {
  with_group(group, [&]<class G>() { static_cast<G*>(group)->twins.advance(job); });
}

void release(void* group) {
  with_group(group, [&]<class G>() { delete static_cast<G*>(group); });
}

#if TENODESIS_LANES > 2
void differentiate_one(const tenodesis_lanes::Gradient& of, std::int64_t outcome[2]) {
  static_assert(PackedDual::directions == tenodesis_lanes::most_directions);
  const Variables<PackedDual> at(of.parameters, of.variables, of.variable_count);
  TwinSpec spec{};
  spec.axis = {JointType(of.joint_type), {}, of.handle_range};
  for (std::size_t p = 0; p < parameter_count; ++p) spec.axis.parameters[p] = value_of(at.axis[p]);
  const auto with_axis = [&]<class A>(const A& axis) {
    AxisTwin<A> twin{};
    fill(twin, axis, spec, at.row, at.axis[tendon_length]);
    const Progress done = differentiate(twin, at.row, of);
    outcome[0] = std::int64_t(done.steps);
    outcome[1] = std::int64_t(done.status);
  };
  const auto any = make_axis(spec.axis, at.axis);
  if (const auto* gear = std::get_if<0>(&any)) return with_axis(*gear);
  if (const auto* pulley = std::get_if<1>(&any)) return with_axis(*pulley);
  with_axis(*std::get_if<2>(&any));
}
#else
constexpr decltype(tenodesis_lanes::Lanes::differentiate) differentiate_one = nullptr;
#endif

}  // namespace
}  // namespace tenodesis::engine

const tenodesis_lanes::Lanes tenodesis_lanes::TENODESIS_PROCESSOR{TENODESIS_LANES,
                                                                  tenodesis::engine::make_group,
                                                                  tenodesis::engine::start,
                                                                  tenodesis::engine::advance,
                                                                  tenodesis::engine::release,
                                                                  tenodesis::engine::differentiate_one};
// NOLINTEND(misc-anonymous-namespace-in-header,misc-definitions-in-headers)

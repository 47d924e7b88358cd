// Included once by each file that is compiled for a kind of processor, which sets TENODESIS_LANES and
// TENODESIS_PROCESSOR first.

#include <new>

#include "lane_twins.hpp"
#include "tenodesis/packed_dual.hpp"
#include "twin_gradient.hpp"

// Each file that includes this has a namespace of its own.
// NOLINTBEGIN(misc-anonymous-namespace-in-header,misc-definitions-in-headers)
namespace tenodesis::engine {
namespace {

// A group with its kind, which says what it is.
template <template <class> class AxisOf>
struct Group {
  int joint_type;
  LaneTwins<AxisOf, TENODESIS_LANES> twins;
};

template <class Work>
void with_group(void* group, const Work& work) {
  // The first member of each is the same.
  switch (JointType(*static_cast<int*>(group))) {
    case JointType::tendon_gear:
      return work(static_cast<Group<GearAxis>*>(group));
    case JointType::tendon_pulley:
      return work(static_cast<Group<PulleyAxis>*>(group));
    case JointType::continuum:
      return work(static_cast<Group<ContinuumAxis>*>(group));
  }
}

template <template <class> class AxisOf>
void* made(const tenodesis_lanes::Kind& kind) {
  return new Group<AxisOf>{kind.joint_type, LaneTwins<AxisOf, TENODESIS_LANES>(kind)};
}

void* make_group(const tenodesis_lanes::Kind& kind) {
  switch (JointType(kind.joint_type)) {
    case JointType::tendon_gear:
      return made<GearAxis>(kind);
    case JointType::tendon_pulley:
      return made<PulleyAxis>(kind);
    case JointType::continuum:
      break;
  }
  return made<ContinuumAxis>(kind);
}

void start(void* group, int lane, const double* parameters, std::uint64_t seed) {
  with_group(group, [&](auto* of) { of->twins.start(lane, parameters, seed); });
}

void advance(void* group, const tenodesis_lanes::Job& job) {
  with_group(group, [&](auto* of) { of->twins.advance(job); });
}

void release(void* group) {
  with_group(group, [](auto* of) { delete of; });
}

void differentiate_one(const tenodesis_lanes::Gradient& of, std::int64_t outcome[2]) {
  static_assert(PackedDual::directions == tenodesis_lanes::most_directions);
  const Variables<PackedDual> at(of.parameters, of.variables, of.variable_count);
  TwinSpec spec{};
  spec.axis = {JointType(of.joint_type), {}, of.handle_range};
  for (std::size_t p = 0; p < parameter_count; ++p) spec.axis.parameters[p] = value_of(at.axis[p]);
  const auto with_axis = [&]<class A>(const A& axis) {
    Twin<A, Contacts<1 + tendon_joints>, CapstanWithConstant<PackedDual>> twin{};
    twin.axis = axis;
    twin.law = {at.row[constant]};
    fill(twin, spec, at.row, at.axis[tendon_length]);
    const Progress done = differentiate(twin, at.row, of);
    outcome[0] = std::int64_t(done.steps);
    outcome[1] = std::int64_t(done.status);
  };
  const auto any = make_axis(spec.axis, at.axis);
  if (const auto* gear = std::get_if<0>(&any)) return with_axis(*gear);
  if (const auto* pulley = std::get_if<1>(&any)) return with_axis(*pulley);
  with_axis(*std::get_if<2>(&any));
}

}  // namespace
}  // namespace tenodesis::engine

const tenodesis_lanes::Lanes tenodesis_lanes::TENODESIS_PROCESSOR{TENODESIS_LANES,
                                                                  tenodesis::engine::make_group,
                                                                  tenodesis::engine::start,
                                                                  tenodesis::engine::advance,
                                                                  tenodesis::engine::release,
                                                                  tenodesis::engine::differentiate_one};
// NOLINTEND(misc-anonymous-namespace-in-header,misc-definitions-in-headers)

#pragma once
// The twin of a chain of joints that may share tendons, of any size.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <numeric>
#include <stdexcept>
#include <type_traits>
#include <utility>

#include "any_twin.hpp"
#include "tenodesis/axis.hpp"
#include "tenodesis/twin_energy.hpp"

namespace tenodesis::engine {

/// Numbers of a contact, of a joint's link and of a load cell, in this order; share: of the joint's angle that the
/// contact takes, and of the constant and viscous friction of joint or sheath.
enum PassageNumber {
  passage_joint,
  passage_coefficient,
  passage_wrap,
  passage_share,
  passage_arm,
  passage_wound,
  passage_numbers
};
enum LinkNumber {
  link_mass,
  link_centre,
  inertia_x,
  inertia_y,
  inertia_z,
  link_damping,
  link_stop_low,
  link_stop_high,
  link_stop_stiffness,
  link_reach,
  link_numbers
};
enum LoadCellNumber {
  load_cell_gain,
  load_cell_bias,
  sensor_noise,
  sensor_range,
  sensor_resolution,
  load_cell_numbers
};

/// Parameters of a chain's twin, in SI units and the order of a row.
#define TENODESIS_WRIST_TWIN_PARAMETERS(ROW)                                                                          \
  ROW(constant), ROW(viscous), ROW(static_ratio), ROW(stribeck_speed), ROW(memory), ROW(load_index),                  \
      ROW(reference_tension), ROW(bending_loss), ROW(sheath_bend_rate), ROW(stiffness_ratio), ROW(pretension_ratio),  \
      ROW(hand_stiffness), ROW(hand_damping), ROW(hand_inertia), ROW(spool_radius), ROW(spool_speed_limit),           \
      ROW(spool_acceleration_limit), ROW(drive_time_constant), ROW(backlash), ROW(encoder_noise), ROW(encoder_range), \
      ROW(encoder_resolution), ROW(handle_encoder_offset), ROW(output_encoder_offset), ROW(motor_encoder_resolution), \
      ROW(gear_efficiency), ROW(friction_torque), ROW(torque_ripple), ROW(ripple_rate), ROW(thermal_drift),           \
      ROW(thermal_time), ROW(time_step)

#define TENODESIS_ROW(name) name
enum class ChainParameter : std::size_t { TENODESIS_WRIST_TWIN_PARAMETERS(TENODESIS_ROW) };
#undef TENODESIS_ROW
#define TENODESIS_ROW(name) #name
inline constexpr std::array chain_twin_names{TENODESIS_WRIST_TWIN_PARAMETERS(TENODESIS_ROW)};
#undef TENODESIS_ROW

/// Friction laws by number; capstan friction without a constant part, and none, are the first with zeros.
using ChainLaw = ChosenLaw<double>::Kind;

/// Constants of a twin in arrays.
struct TwinRows {
  const double* passages;  ///< tendons x contacts x numbers
  std::size_t most_contacts;
  const std::vector<int>& contacts;  ///< of each tendon
  const double* segments;            ///< stiffness, tendons x (contacts + 1), N/m
  const double* links;
  const double* load_cells;
  const double* damping;  ///< of each tendon, N s/m
  const double* rig;      ///< wrench on the tip by a newton on the load rig
  const double* parameters;
  ChainLaw law{};
  int steps_per_sample{1};
  bool quasi_static{};
  bool currents{};
  std::uint64_t seed{};
};

/// Link of a joint that is there only since its chain is built for more joints than it has.
template <class S>
inline constexpr Link<S> inert_link{.inertia = {S(1), S(1), S(1)}};

/// Fills in the constants of a twin whose chain is there.
template <class T>
void fill(T& twin, const TwinRows& rows, const ChainSizes& sizes) {
  const auto p = [&](ChainParameter at) { return rows.parameters[std::size_t(at)]; };
  using enum ChainParameter;
  constexpr int N = T::N;
  for (std::size_t m = 0; m < sizes.tendons; ++m) {
    const int n = rows.contacts[m];
    auto& tendon = twin.tendon[m];
    twin.chain.stiffness[m] *= p(stiffness_ratio);
    twin.chain.pretension[m] *= p(pretension_ratio);
    tendon.rest_tension = twin.chain.pretension[m];
    if constexpr (!T::known) {
      twin.tendon_damping[m] = rows.damping[m];
      if (twin.chain.grows(int(m))) twin.chain.curves.at[m].rest_at(tendon.rest_tension);
    }
    if constexpr (requires { tendon.stiffness.length; }) tendon.stiffness.length = n + 1;
    for (int i = 0; i <= n; ++i)
      tendon.stiffness[i] = p(stiffness_ratio) * rows.segments[m * (rows.most_contacts + 1) + std::size_t(i)];
    for (int j = 0; j < n; ++j) {
      const double* at = rows.passages + (m * rows.most_contacts + std::size_t(j)) * passage_numbers;
      const int joint = int(at[passage_joint]);
      // Joints of the handle are counted from the room for the tip's on.
      const int place = std::cmp_less(joint, sizes.joints) ? joint : joint - int(sizes.joints) + N;
      twin.passage[m][j] = {place,           at[passage_coefficient], at[passage_wrap], at[passage_share],
                            at[passage_arm], at[passage_wound]};
    }
    const double* cell = rows.load_cells + m * load_cell_numbers;
    twin.load_cell[m] = {cell[load_cell_gain], cell[load_cell_bias], cell[sensor_noise],
                         -cell[sensor_range],  cell[sensor_range],   cell[sensor_resolution]};
  }
  for (std::size_t i = 0; i < sizes.joints; ++i) {
    const double* at = rows.links + i * link_numbers;
    twin.link[i] = {at[link_mass], at[link_centre], {at[inertia_x], at[inertia_y], at[inertia_z]}};
    twin.damping[i] = at[link_damping];
    twin.stop_low[i] = at[link_stop_low];
    twin.stop_high[i] = at[link_stop_high];
    twin.stop_stiffness[i] = at[link_stop_stiffness];
    twin.reach[i] = at[link_reach];
  }
  for (std::size_t i = sizes.joints; i < std::size_t(N); ++i) {
    twin.link[i] = inert_link<typename T::S>;
    twin.stop_low[i] = -pi;
    twin.stop_high[i] = pi;
  }
  twin.viscous = p(viscous);
  twin.sheath_bend_rate = p(sheath_bend_rate);
  twin.hand = {p(hand_stiffness), p(hand_damping), p(hand_inertia)};
  twin.drive = {p(spool_radius), p(spool_speed_limit), p(spool_acceleration_limit), p(drive_time_constant),
                p(backlash)};
  twin.rig = {{rows.rig[0], rows.rig[1], rows.rig[2]}, {rows.rig[3], rows.rig[4], rows.rig[5]}};
  const double half = p(encoder_range) / 2;
  const auto encoder = [&](double offset) {
    return Sensor<double>{1, offset, p(encoder_noise), -half, half, p(encoder_resolution)};
  };
  twin.handle_encoder = encoder(p(handle_encoder_offset));
  twin.output_encoder = encoder(p(output_encoder_offset));
  twin.motor_encoder = {1, 0, 0, -1e9, 1e9, p(motor_encoder_resolution)};  // a motor's encoder has no end
  twin.time_step = p(time_step);
  if (rows.currents) {
    const double sample = p(time_step) * rows.steps_per_sample;
    twin.current = {true,           p(gear_efficiency), p(friction_torque) / p(spool_radius), p(torque_ripple),
                    p(ripple_rate), p(thermal_drift),   sample / (p(thermal_time) + sample)};
  }
  twin.steps_per_sample = rows.steps_per_sample;
  twin.quasi_static = rows.quasi_static;
  if constexpr (requires { twin.law.kind; })
    twin.law = {rows.law,
                {p(constant)},
                {p(constant), p(static_ratio), p(stribeck_speed), p(memory)},
                {p(constant), p(load_index), p(reference_tension), p(bending_loss),
                 1e-3 * *std::ranges::max_element(twin.chain.pretension)}};
  else
    twin.law = {p(constant)};
  twin.prepare();
}

/// A twin with its state.
template <class T>
class ChainTwin final : public AnyTwin {
 public:
  using State = T::State;
  using Command = T::Command;
  static_assert(std::is_trivially_copyable_v<State>);

  ChainTwin(const T& twin, const ChainSizes& sizes, std::uint64_t seed)
      : sizes_(sizes), twin_(twin), state_(twin.rest(seed)) {}

  std::unique_ptr<AnyTwin> copy() const override { return std::make_unique<ChainTwin>(*this); }
  const ChainSizes& sizes() const override { return sizes_; }
  std::vector<Column> commands() const override { return chain_commands(sizes_); }
  std::vector<Column> signals() const override { return chain_signals(sizes_); }
  Status step(const double* command) override { return twin_.step(command_of(command), state_); }

  bool step_or_hold(const double* command) override {
    Command given = command_of(command);
    if (twin_.step(given, state_) == Status::ok) return true;
    Command held = state_.command;
    std::ranges::copy(given.spool_velocity, held.spool_velocity);
    twin_.step(held, state_);
    return false;
  }

  Status audit(const double* command, double* energy) override {
    const State before = state_;
    const Status found = step(command);
    if (found != Status::ok) return found;
    const auto of = twin_energy(twin_, before, state_);
    energy[1] = of.stored;
    energy[2] += of.handle;
    energy[3] += of.spools;
    energy[4] += of.load;
    energy[5] += of.friction;
    energy[6] += of.damping;
    energy[7] += of.tissue;
    energy[8] = std::min(energy[8], of.friction_at_end);
    energy[9] = std::max(energy[9], twin_.residual(before, state_));
    energy[10] = std::max(energy[10], double(state_.sweeps));
    return found;
  }

  double stored() const override { return stored_energy(twin_, state_); }

  double* store(double* out) const override {
    store_signals(twin_, state_, shape(), [&](double value) { *out++ = value; });
    return out;
  }

  Measurement<double> reading(const CompensatedAxis& of) const override {
    return {state_.measured_handle[of.handle],
            {state_.measured_tension[of.agonist], state_.measured_tension[of.antagonist]},
            {state_.measured_spool[of.agonist], state_.measured_spool[of.antagonist]}};
  }

  double force() const override { return twin_.load_of(state_.command).wrench.force.x; }
  double handle_wanted(std::size_t h) const override { return state_.command.handle_angle[h]; }
  Contact<double> contact(std::size_t joint) const override { return state_.command.contact[joint]; }
  bool inside(std::size_t joint, const Contact<double>& contact) const override {
    const auto path = twin_.path(int(joint));
    return touches(path, contact, tip_at(path, state_.angle[joint]));
  }

  std::string state() const override {
    std::string bytes(sizeof(State), '\0');
    std::memcpy(bytes.data(), &state_, sizeof(State));
    return bytes;
  }

  void set_state(std::string_view bytes) override {
    if (bytes.size() != sizeof(State)) throw std::invalid_argument("the state belongs to another kind of twin");
    std::memcpy(&state_, &bytes.front(), sizeof(State));
  }

  std::optional<LaneTwinBytes> in_lanes() const override {
    if constexpr (T::known)
      if (!twin_.current.on)
        return LaneTwinBytes{{T::N, int(twin_.mechanism(0)), twin_.quasi_static, step_alone},
                             !twin_.prescribed(),
                             twin_.steps_per_sample,
                             state_.until_sample,
                             &twin_,
                             &state_};
    return std::nullopt;
  }

  std::vector<tenodesis_lanes::Column> lane_columns() const override {
    std::vector<tenodesis_lanes::Column> all(width_of(commands()));
    for (std::size_t c = 0; c < all.size(); ++c) all[c] = {c, 1};
    return all;
  }

 private:
  static std::int64_t step_alone(const void* twin, const void* command, void* state) {
    return std::int64_t(
        static_cast<const T*>(twin)->step(*static_cast<const Command*>(command), *static_cast<State*>(state)));
  }

  Command command_of(const double* from) const {
    return chain_command<Command>(shape(), [&] { return *from++; }, [](double column) { return column != 0; });
  }

  // Its sizes, as constants where the layout is known.
  ChainSizes shape() const {
    if constexpr (T::known)
      return {T::N, T::N, T::M};
    else
      return sizes_;
  }

  ChainSizes sizes_;
  T twin_{};
  State state_{};
};

inline constexpr int most_short_sheath_contacts = 4;
inline constexpr int most_long_sheath_contacts = 32;
inline constexpr int most_vertices = 2;

/// The same chain as another type, with room for more tendons or a known layout.
template <class To, class W>
To as(const W& chain) {
  To to{};
  std::ranges::copy(chain.joint, to.joint);
  for (int m = 0; m < W::tendons; ++m) {
    std::ranges::copy(chain.arm[m], to.arm[m]);
    std::ranges::copy(chain.handle_arm[m], to.handle_arm[m]);
    to.stiffness[m] = chain.stiffness[m];
    to.pretension[m] = chain.pretension[m];
    to.motor[m] = chain.motor[m];
    if constexpr (!To::known) to.curves.at[m] = chain.curves.at[m];
  }
  to.handles = chain.handles;
  std::ranges::copy(chain.handle, to.handle);
  return to;
}

/// Whether a chain and its routes are what a known layout says.
template <class Known, class W>
bool fits(const W& chain, const TwinRows& rows) {
  constexpr auto& layout = Known::layout;
  bool same = chain.handles == W::joints && chain.is_linear();
  for (int i = 0; i < W::joints; ++i) {
    const auto& joint = chain.joint[i];
    const bool across = (layout.axis[i] == Along::x ? joint.axis.y : joint.axis.x) == 0 && joint.axis.z == 0;
    same = same && joint.parent == i - 1 && joint.mechanism == layout.mechanism[i] && across &&
           chain.handle[i] == layout.mechanism[W::joints + i];
  }
  for (int m = 0; m < W::tendons; ++m) {
    same = same && chain.stiffness[m] > 0 && std::size_t(m) < rows.contacts.size() &&
           rows.contacts[std::size_t(m)] == layout.contacts[m] && rows.damping[m] == 0;
    for (int j = 0; same && j < layout.contacts[m]; ++j) {
      const double* at = rows.passages + (std::size_t(m) * rows.most_contacts + std::size_t(j)) * passage_numbers;
      same = at[passage_joint] == layout.joint[m][j] && (at[passage_arm] != 0) == layout.draws[m][j];
    }
  }
  return same;
}

template <int N, Mechanism tip>
using PlanarChain = TendonChain<double, N, 2 * N, planar_layout<N>(tip)>;

/// Calls work with the chain as a type of a known layout, if that fits it; returns whether it does.
template <class Known, class W, class Work>
bool if_fits(const W& chain, const TwinRows& rows, const Work& work) {
  if (rows.law != ChainLaw::capstan_with_constant || !fits<Known>(chain, rows)) return false;
  work(as<Known>(chain));
  return true;
}

/// The same with the known layout that fits, if there is one.
template <class W, class Work>
bool with_layout(const W& chain, const TwinRows& rows, const Work& work) {
  constexpr int N = W::joints;
  using enum Mechanism;
  if constexpr (N <= most_axes && W::tendons == 2 * N)
    return if_fits<PlanarChain<N, gear>>(chain, rows, work) || if_fits<PlanarChain<N, pulley>>(chain, rows, work) ||
           if_fits<PlanarChain<N, continuum>>(chain, rows, work);
  return false;
}

template <class T>
std::unique_ptr<AnyTwin> filled(const typename T::TendonChain& chain, const TwinRows& rows, const ChainSizes& sizes) {
  T twin{};
  twin.chain = chain;
  fill(twin, rows, sizes);
  return std::make_unique<ChainTwin<T>>(twin, sizes, rows.seed);
}

/// The twin of a chain. Known layouts with the capstan's law are the fastest, then short routes with that law; others
/// make do with one size, that of most tendons M.
template <int M, class W>
std::unique_ptr<AnyTwin> make_twin(const W& chain, const TwinRows& rows, const ChainSizes& sizes) {
  using S = W::S;
  constexpr int N = W::joints;
  std::unique_ptr<AnyTwin> made;
  if (with_layout(chain, rows, [&]<class Known>(const Known& same) {
        made = filled<Twin<Known, Known::layout.most_contacts>>(same, rows, sizes);
      }))
    return made;
  constexpr int few = 2 * N + most_short_sheath_contacts;
  if (rows.law == ChainLaw::capstan_with_constant && *std::ranges::max_element(rows.contacts) <= few)
    return filled<Twin<W, few>>(chain, rows, sizes);
  using Roomy = TendonChain<S, N, M>;
  constexpr int many = 2 * most_vertices * N + most_long_sheath_contacts;
  return filled<Twin<Roomy, many, ChosenLaw<S>>>(as<Roomy>(chain), rows, sizes);
}

}  // namespace tenodesis::engine

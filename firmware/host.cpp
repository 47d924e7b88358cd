// Records a bench run with the controller in the loop, as in Fig. 15: the handle is moved to an angle and held, then a
// load is applied to the tip. Usage: host FILE

#include <cstdio>

#include "recording.hpp"
#include "tenodesis/axis_twin.hpp"

namespace {

using namespace tenodesis;
using Plant = AxisTwin<GearAxis<double>>;

constexpr double degree = pi / 180;
constexpr double handle_angle = 33.2 * degree;  // an output angle of 80 degrees
constexpr double approach = 1.5;                // s
constexpr double loaded_at = 4;                 // s
constexpr double weight = 10;                   // N; 0.15 N m about the rig's pivot
constexpr double duration = 10;                 // s
constexpr double friction_error = 1.3;          // of the plant's friction over that of the parameters
constexpr double stiffness_error = 0.85;        // the same of the tendons' stiffness, as on the paper's bench

/// The axis of the parameters, with other stiffness.
GearAxis<double> bench_axis() {
  const tenodesis_axis_parameters& axis = scaled_up.axis[0];
  return {{axis.proximal_radius, axis.handle_length},
          {axis.distal_radius, axis.end_effector_length},
          axis.stiffness * stiffness_error,
          axis.pretension,
          axis.handle_range};
}

/// Its twin, with other friction, and with the bench's drives and noisy sensors.
Plant plant() {
  const tenodesis_axis_parameters& axis = scaled_up.axis[0];
  const GearAxis<double> own = bench_axis();
  Plant plant{};
  set_axis(plant, own,
           {axis.vertex_coefficient * friction_error, axis.sheath_coefficient * friction_error, axis.sheath_bend});
  const float share[] = {axis.share_sheath, axis.share_handle, axis.share_stem, axis.share_tip};
  for (auto& tendon : plant.tendon)
    for (int i = 0; i < 4; ++i) tendon.stiffness[i] = own.stiffness / double(share[i]);
  set_tip(plant, 4e-4, 9e-3, 1.86, 25.8);
  set_rig(plant, 0.015, own.distal.rig_arm());
  plant.drive = {axis.spool_radius, scaled_up.speed_limit, scaled_up.acceleration_limit, axis.drive_time_constant, 0};
  plant.handle_encoder = plant.output_encoder = {1, 0, 0.03 * degree, -pi, pi, 2 * pi / 4096};
  for (auto& cell : plant.load_cell) cell = {1, 0, 0.03, -200, 200, 200.0 / 32768};
  plant.motor_encoder = {1, 0, 0, -1e9, 1e9, 2 * pi / 4096};
  plant.time_step = double(scaled_up.period);
  plant.prepare();
  return plant;
}

/// From 0 to 1 without a jump in speed or acceleration.
double rise(double share) {
  const double u = smaller(share, 1.0);
  return u * u * u * (10 - 15 * u + 6 * u * u);
}

bool record(std::FILE* file) {
  const Plant bench = plant();
  auto twin = bench.rest(1);
  instrument::Direct controller;
  if (!controller.ready()) return false;
  const auto ticks = static_cast<std::uint32_t>(round(duration / bench.time_step));
  const recording::Header header{ticks, sizeof(recording::Tick)};
  bool written = std::fwrite(&header, sizeof header, 1, file) == 1;
  for (std::uint32_t n = 0; n < ticks; ++n) {
    const double time = n * bench.time_step;
    const auto input = measurement_as<instrument::Input>(reading_of(twin));
    const recording::Tick tick{input, controller.step(input)};
    written = written && std::fwrite(&tick, sizeof tick, 1, file) == 1;
    Command<double> command{};
    command.handle_angle = handle_angle * rise(time / approach);
    command.weight = time >= loaded_at ? weight : 0;
    for (int i = 0; i < 2; ++i) command.spool_velocity[i] = tick.output.axis.spool_velocity[i];
    if (const Status found = bench.step(command_of<Plant::Command>(command), twin); found != Status::ok) {
      std::printf("tick %u: the twin stopped with status %d\n", n, static_cast<int>(found));
      return false;
    }
  }
  const GearAxis<double> axis = bench_axis();
  const double wanted = axis.distal.angle(axis.proximal.coordinate(handle_angle) * axis.proximal.excursion_slope() /
                                          axis.distal.excursion_slope());
  std::printf("recorded: %u ticks of %g ms; the tip ends %.2f degrees from its target\n", ticks, bench.time_step * 1e3,
              (twin.angle[0] - wanted) / degree);
  return written;
}

}  // namespace

int main(int count, char** arguments) {
  std::FILE* file = count == 2 ? std::fopen(arguments[1], "wb") : nullptr;
  if (file == nullptr) return 2;
  const bool recorded = record(file);
  const bool closed = std::fclose(file) == 0;
  return recorded && closed ? 0 : 1;
}

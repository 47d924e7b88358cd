// Records a bench run with the controller in the loop, as Fig. 15 has them: the handle is brought to an angle and held,
// then a load falls on the tip. Usage: host FILE

#include <cstdio>

#include "recording.hpp"
#include "tenodesis/twin.hpp"

namespace {

using namespace tenodesis;
using Plant = Twin<GearAxis<double>, Contacts<3>, CapstanWithConstant<double>>;

constexpr double degree = pi / 180;
constexpr double handle_angle = 33.2 * degree;  // an output angle of 80 degrees
constexpr double approach = 1.5;                // s
constexpr double loaded_at = 4;                 // s
constexpr double weight = 10;                   // N; 0.15 N m about the rig's pivot
constexpr double duration = 10;                 // s
constexpr double friction_error = 1.3;          // of the plant's friction over what the controller takes it for

/// The instrument that the controller takes it for, but for friction, with the bench's drives and noisy sensors.
Plant plant() {
  const auto& model = instrument::model;
  const auto& axis = model.axis;
  Plant plant{};
  plant.axis = {{axis.proximal.radius, axis.proximal.length},
                {axis.distal.radius, axis.distal.length},
                axis.stiffness,
                axis.pretension,
                axis.handle_range};
  for (int i = 0; i < 4; ++i) plant.tendon.stiffness[i] = plant.axis.stiffness / double(model.share[i]);
  plant.tendon.rest_tension = plant.axis.pretension;
  plant.friction = {model.vertex * friction_error, model.sheath * friction_error, model.sheath_bend};
  plant.body = {4e-4, 9e-3, 1.86, 25.8};
  plant.rig = {0.015, axis.distal.rig_arm()};
  plant.drive = {model.spool_radius, 20, 400, 0.01, 0};
  const Sensor<double> encoder{1, 0, 0.03 * degree, -pi, pi, 2 * pi / 4096};
  const Sensor<double> load_cell{1, 0, 0.03, -200, 200, 200.0 / 32768};
  plant.sensors = {encoder, encoder, {load_cell, load_cell}, {1, 0, 0, -1e9, 1e9, 2 * pi / 4096}};
  plant.time_step = double(instrument::tick);
  return plant;
}

/// From 0 to 1 without a jump in speed or acceleration.
double rise(double share) {
  const double u = smaller(share, 1.0);
  return u * u * u * (10 - 15 * u + 6 * u * u);
}

instrument::Input input_of(const Reading<double>& reading) {
  instrument::Input input{static_cast<float>(reading.handle_angle)};
  for (int i = 0; i < 2; ++i) {
    input.tension[i] = static_cast<float>(reading.tension[i]);
    input.spool_angle[i] = static_cast<float>(reading.spool_angle[i]);
  }
  return input;
}

bool record(std::FILE* file) {
  const Plant bench = plant();
  auto twin = bench.rest(1);
  instrument::State state = instrument::start();
  const auto ticks = static_cast<std::uint32_t>(round(duration / bench.time_step));
  const recording::Header header{ticks, sizeof(recording::Tick)};
  bool written = std::fwrite(&header, sizeof header, 1, file) == 1;
  for (std::uint32_t n = 0; n < ticks; ++n) {
    const double time = n * bench.time_step;
    const instrument::Input input = input_of(twin.reading);
    const recording::Tick tick{input, instrument::step(input, state)};
    written = written && std::fwrite(&tick, sizeof tick, 1, file) == 1;
    Command<double> command{};
    command.handle_angle = handle_angle * rise(time / approach);
    command.weight = time >= loaded_at ? weight : 0;
    for (int i = 0; i < 2; ++i) command.spool_velocity[i] = instrument::spool_velocity(tick.output, i);
    if (const Status found = bench.step(command, twin); found != Status::ok) {
      std::printf("tick %u: the twin stopped with status %d\n", n, static_cast<int>(found));
      return false;
    }
  }
  const auto& axis = bench.axis;
  const double wanted = axis.distal.angle(axis.proximal.coordinate(handle_angle) * axis.proximal.excursion_slope() /
                                          axis.distal.excursion_slope());
  std::printf("recorded: %u ticks of %g ms; the tip ends %.2f degrees from its target\n", ticks, bench.time_step * 1e3,
              (twin.output_angle - wanted) / degree);
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

// Claims about homing on a plant of a few lines: a tip with inertia between two springs, on motors with a lag.

#include "control_parameters.hpp"

#include "tenodesis/current.hpp"
#include "tenodesis/sensor.hpp"

namespace {

struct Plant {
  GearAxis<double> axis{};
  double inertia{}, damping{};
  double spool[2]{}, speed[2]{};  // rad; zero where the tendons of a straight tip begin to be tight
  double angle{}, velocity{};     // of the tip
  Noise noise{7};

  double tension(int i) const {
    const double excursion = axis.distal.radius * angle;
    return std::max(0.0, axis.stiffness * (spool_radius * spool[i] - (i == agonist ? excursion : -excursion)));
  }

  void step(const double (&sent)[2]) {
    constexpr int parts = 20;
    for (int part = 0; part < parts; ++part) {
      const double h = dt / parts;
      for (int i = 0; i < 2; ++i) {
        speed[i] += (sent[i] - speed[i]) * h / 0.01;
        spool[i] += speed[i] * h;
      }
      const double moment = axis.distal.radius * (tension(agonist) - tension(antagonist));
      velocity += (moment - damping * velocity) / inertia * h;
      angle += velocity * h;
    }
  }

  template <class S>
  Measurement<S> read() {
    Measurement<S> seen{};
    for (int i = 0; i < 2; ++i) {
      seen.tension[i] = S(tension(i) + 0.03 * noise.normal<double>());
      seen.spool_angle[i] = S(std::round(spool[i] / counts) * counts);
    }
    return seen;
  }
};

struct End {
  HomingFailure failure{};
  bool homed{};
  double tension[2]{};
  double moved{};  // rad
};

template <class S>
End home(double slack, const GearAxis<double>& axis) {
  auto p = parameters(axis, ControlLaw::robust, Actuation::differential);
  p.homed = 0;
  const auto made = controller<typename GearAxis<double>::template Rebind<S>>(p);
  auto state = made.start();
  const bool small = axis.distal.radius < 5e-3;
  Plant plant{axis, small ? 4e-6 : 4e-4, small ? 4e-4 : 9e-3};
  const double stretch = axis.pretension / axis.stiffness;
  for (double& angle : plant.spool) angle = (slack > 0 ? -slack : stretch) / spool_radius;
  End end{};
  std::uint64_t time = 0;
  for (int n = 0; n < 40000; ++n) {
    ControlInput<S, 1> input{time += tick, n == 5 ? Request::home : Request::none, {plant.read<S>()}};
    ControlOutput<S, 1> output{};
    made.step(input, state, output);
    const double sent[2]{double(output.axis[0].spool_velocity[0]), double(output.axis[0].spool_velocity[1])};
    plant.step(sent);
    end.moved = std::max(end.moved, std::fabs(plant.angle));
    end.failure = output.axis[0].homing_failure;
    end.homed = output.homed;
    if (n > 5 && output.state != OperatingState::enabled) break;
  }
  for (int i = 0; i < 2; ++i) end.tension[i] = plant.tension(i);
  return end;
}

template <class S>
void a_free_tip_is_homed_without_being_moved() {
  for (const auto& axis : {instruments::scaled_up<double>(), instruments::real_size<double>()}) {
    for (const double slack : {0.0, 0.5e-3, 6e-3}) {
      const End end = home<S>(slack, axis);
      CLAIM(end.homed && end.failure.reason == HomingReason::none);
      for (const double tension : end.tension) CLAIM_NEAR(tension, axis.pretension, 0.01 * axis.pretension);
      CLAIM(end.moved < 1 * degree);
    }
  }
}

void a_failure_and_its_word_say_the_same() {
  for (int reason = 0; reason < homing_reason_count; ++reason) {
    for (const int tendon : {no_tendon, agonist, antagonist}) {
      const HomingFailure back = HomingFailure::of_word(HomingFailure{HomingReason(reason), tendon}.word());
      CLAIM(back.reason == HomingReason(reason) && back.tendon == tendon);
    }
  }
  CLAIM(HomingFailure{}.word() == 0);
}

template <class S>
void a_drives_friction_is_taken_out_of_a_reading_by_its_edge() {
  const S gain = S(0.98), play = S(15e-6), tension = S(20);
  const HomingDrive<S> drive{S(0.9), S(1), gain, play};
  HomingDriveState<S> state{};
  const CurrentSense<S> by{true, S(0.9), S(1)};
  CurrentState<S> sensed{tension, S(0), S(0)};
  S angle{}, known{};
  const auto turn = [&](double speed, double steps) {
    for (int i = 0; i < 20; ++i) {
      angle = angle + S(speed * 5e-4);
      const S counted = round(angle * S(650)) / S(650);
      const S stroke = S(spool_radius) * counted;
      known = drive.tension(gain * sense(by, tension, angle, sensed), stroke, S(speed), state);
      if (i < steps) CLAIM_NEAR(known, tension, 1e-4 * tension);
    }
  };
  turn(1, 0);
  CLAIM_NEAR(known, tension, 1e-4 * tension);
  // Not even while friction turns, within a step of the encoder.
  turn(-1, 20);
  turn(1, 20);
  turn(0, 20);
  const HomingDrive<S> cell{};
  CLAIM(cell.tension(S(7), S(1), S(-1), state) == S(7) && cell.uncertainty(S(7)) == S(0));
}

template <class S>
void run() {
  a_drives_friction_is_taken_out_of_a_reading_by_its_edge<S>();
  a_free_tip_is_homed_without_being_moved<S>();
}

}  // namespace

int main() {
  a_failure_and_its_word_say_the_same();
  run<double>();
  run<float>();
  return claims::report();
}

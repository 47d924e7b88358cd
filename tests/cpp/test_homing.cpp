// Claims about homing on a plant of a few lines: a tip with inertia between two springs, on motors with a lag.

#include "control_parameters.hpp"

#include "tenodesis/current.hpp"
#include "tenodesis/sensor.hpp"

namespace {

/// What is wrong with the plant or its cables.
struct Wrong {
  double load{};  ///< moment on the tip, N m
  double bias{};  ///< of the agonist's cell, N
  bool cells_swapped{}, motors_swapped{}, encoders_swapped{};
  double motor{1}, encoder{1};  ///< gains of the agonist's
};

struct Plant {
  GearAxis<double> axis{};
  double inertia{}, damping{};
  Wrong wrong{};
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
        const double wanted = sent[wrong.motors_swapped ? 1 - i : i] * (i == agonist ? wrong.motor : 1);
        speed[i] += (wanted - speed[i]) * h / 0.01;
        spool[i] += speed[i] * h;
      }
      const double moment = axis.distal.radius * (tension(agonist) - tension(antagonist)) - wrong.load;
      velocity += (moment - damping * velocity) / inertia * h;
      angle += velocity * h;
    }
  }

  template <class S>
  Measurement<S> read() {
    double cell[2], counted[2];
    for (int i = 0; i < 2; ++i) {
      cell[i] = tension(i) + 0.03 * noise.normal<double>() + (i == agonist ? wrong.bias : 0);
      counted[i] = std::round(spool[i] / counts) * counts * (i == agonist ? wrong.encoder : 1);
    }
    const auto side = [](bool swapped, int i) { return swapped ? 1 - i : i; };
    Measurement<S> seen{};
    for (int i = 0; i < 2; ++i) {
      seen.tension[i] = S(cell[side(wrong.cells_swapped, i)]);
      seen.spool_angle[i] = S(counted[side(wrong.encoders_swapped, i)]);
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
End home(double slack, const Wrong& wrong, const GearAxis<double>& axis = instruments::scaled_up<double>()) {
  auto p = parameters(axis, ControlLaw::robust, Actuation::differential);
  p.homed = 0;
  const auto made = controller<typename GearAxis<double>::template Rebind<S>>(p);
  auto state = made.start();
  const bool small = axis.distal.radius < 5e-3;
  Plant plant{axis, small ? 4e-6 : 4e-4, small ? 4e-4 : 9e-3, wrong};
  const double stretch = axis.pretension / axis.stiffness;
  for (double& angle : plant.spool) angle = (slack > 0 ? -slack : stretch) / spool_radius;
  // The load comes before homing, and the tip comes to rest.
  const double rest[2]{};
  for (int n = 0; n < 10000; ++n) plant.step(rest);
  const double from = plant.angle;
  End end{};
  std::uint64_t time = 0;
  for (int n = 0; n < 40000; ++n) {
    ControlInput<S, 1> input{time += tick, n == 5 ? Request::home : Request::none, {plant.read<S>()}};
    ControlOutput<S, 1> output{};
    made.step(input, state, output);
    const double sent[2]{double(output.axis[0].spool_velocity[0]), double(output.axis[0].spool_velocity[1])};
    plant.step(sent);
    end.moved = std::max(end.moved, std::fabs(plant.angle - from));
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
      const End end = home<S>(slack, {}, axis);
      CLAIM(end.homed && end.failure.reason == HomingReason::none);
      for (const double tension : end.tension) CLAIM_NEAR(tension, axis.pretension, 0.01 * axis.pretension);
      CLAIM(end.moved < 1 * degree);
    }
  }
}

template <class S>
void whatever_is_wrong_is_named_before_the_tip_has_moved_far() {
  using enum HomingReason;
  struct Case {
    Wrong wrong;
    HomingReason tight, slack;
    int tendon;
  };
  const Case cases[] = {
      {.wrong = {.load = 0.05}, .tight = tip_loaded, .slack = tip_loaded, .tendon = no_tendon},
      {.wrong = {.load = -0.13}, .tight = tip_loaded, .slack = tip_loaded, .tendon = no_tendon},
      {.wrong = {.bias = 3}, .tight = cell_offset, .slack = cell_offset, .tendon = agonist},
      {.wrong = {.cells_swapped = true}, .tight = cells_swapped, .slack = cells_swapped, .tendon = no_tendon},
      {.wrong = {.motors_swapped = true, .encoders_swapped = true},
       .tight = cells_swapped,
       .slack = cells_swapped,
       .tendon = no_tendon},
      {.wrong = {.motors_swapped = true}, .tight = motors_swapped, .slack = motors_swapped, .tendon = no_tendon},
      {.wrong = {.encoders_swapped = true}, .tight = encoders_swapped, .slack = motors_swapped, .tendon = no_tendon},
      {.wrong = {.motor = -1}, .tight = motor_reversed, .slack = motor_reversed, .tendon = agonist},
      {.wrong = {.encoder = -1}, .tight = encoder_reversed, .slack = motor_reversed, .tendon = agonist},
      {.wrong = {.motor = -1, .encoder = -1}, .tight = spool_reversed, .slack = spool_reversed, .tendon = agonist},
      {.wrong = {.motor = 0}, .tight = motor_dead, .slack = motor_dead, .tendon = agonist},
      {.wrong = {.encoder = 2}, .tight = encoder_gain, .slack = encoder_gain, .tendon = agonist},
  };
  for (const Case& one : cases) {
    for (const double slack : {0.0, 3e-3}) {
      const End end = home<S>(slack, one.wrong);
      CLAIM(end.failure.reason == (slack > 0 ? one.slack : one.tight) && end.failure.tendon == one.tendon);
      CLAIM(!end.homed && end.moved < 3 * degree);
      if (end.failure.reason != (slack > 0 ? one.slack : one.tight))
        std::printf("    %s with %g m of slack, case %d\n", name(end.failure.reason), slack, int(&one - cases));
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
  whatever_is_wrong_is_named_before_the_tip_has_moved_far<S>();
}

}  // namespace

int main() {
  a_failure_and_its_word_say_the_same();
  run<double>();
  run<float>();
  return claims::report();
}

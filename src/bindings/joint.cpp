// The geometry of a joint by its mechanism, over arrays.

#include "tenodesis/joint.hpp"
#include "module.hpp"
#include "tenodesis/route.hpp"

namespace tenodesis::bindings {
namespace {

Mechanism mechanism_of(int number) {
  require(number >= 0 && number <= int(Mechanism::continuum), "no such mechanism");
  return Mechanism(number);
}

NewRows joint_chord(int mechanism, double chord, const In<1>& angle) {
  const Mechanism of = mechanism_of(mechanism);
  const std::size_t count = angle.shape(0);
  NewRows out = new_rows(2, count);
  for (std::size_t i = 0; i < count; ++i) {
    const Bend<double> bend(of, chord, coordinate_at(of, angle.data()[i]));
    out(0, i) = bend.chord;
    out(1, i) = bend.chord_rate;
  }
  return out;
}

NewRows joint_coordinate(const std::vector<int>& mechanism, const In<1>& angle) {
  const std::size_t count = angle.shape(0);
  require(mechanism.size() == count, "every angle needs a mechanism");
  NewRows out = new_rows(2, count);
  for (std::size_t i = 0; i < count; ++i) {
    const Mechanism of = mechanism_of(mechanism[i]);
    out(0, i) = coordinate_at(of, angle.data()[i]);
    out(1, i) = Bend<double>(of, 0.0, out(0, i)).turn;
  }
  return out;
}

}  // namespace

void bind_joint(nb::module_& m) {
  m.def(
      "joint_chord", &joint_chord, "mechanism"_a, "chord"_a, "angle"_a,
      "Chord of a joint at angles (rad) by that of the straight joint, m, and its rate by the angle, m/rad: two rows.");
  m.def("joint_coordinate", &joint_coordinate, "mechanism"_a, "angle"_a,
        "Coordinates of joints at their angles (rad), in which tendon excursion is linear, and their rates by them.");
  m.def(
      "joint_straight_chord",
      [](int mechanism, double radius, double backbone) {
        return straight_chord(mechanism_of(mechanism), radius, backbone);
      },
      "mechanism"_a, "radius"_a, "backbone_length"_a, "Chord of a straight joint, m.");
  m.def(
      "joint_excursion",
      [](int mechanism, double distance) { return excursion_slope(mechanism_of(mechanism), distance); }, "mechanism"_a,
      "distance"_a, "Tendon drawn by a unit of the coordinate at a distance (m) from the joint's middle plane, m.");
  m.def(
      "joint_wound_bend",
      [](int mechanism, double bend, double lengthens) { return wound_bend(mechanism_of(mechanism), bend, lengthens); },
      "mechanism"_a, "bend"_a, "lengthens"_a,
      "Bend of a tendon over a straight joint that the joint's angle unwinds, rad, positive in the angle's sense.");
  m.def(
      "joint_wrap", [](double wound, double angle) { return wrap_at(Passage<double>{.wound = wound}, angle); },
      "wound"_a, "angle"_a, "Wrap of a tendon over a joint at an angle, by the bend that the angle unwinds, rad.");
}

}  // namespace tenodesis::bindings

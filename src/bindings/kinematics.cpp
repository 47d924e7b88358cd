// Kinematics for Python: rows of joint coordinates in, frames, lines, Jacobians and coordinates out.

#include "tenodesis/kinematics.hpp"

#include <algorithm>
#include <cmath>
#include <ranges>
#include <tuple>
#include <utility>
#include <variant>
#include <vector>

#include "chain_spec.hpp"
#include "evaluate.hpp"
#include "module.hpp"

namespace tenodesis::bindings {
namespace {

using namespace engine;

constexpr int most_joints = int(engine::most_joints);
using AnyChain = Chain<double, most_joints>;
using At = Posture<double, most_joints>;

// Columns of a row: pan, tilt, spin, insertion, the tip's joints, roll, the handle's joints.
constexpr std::size_t own_columns = 5;
constexpr std::size_t frame_length = 7;   // x, y, z; w, x, y, z
constexpr std::size_t tip_frames = 4;     // carrier, far, end-effector, end
constexpr std::size_t handle_frames = 3;  // carrier, far, grip

/// A tendon's passage over a joint: whether that is at the tip, its place there, the tendon's offset from its middle.
using Passage = std::tuple<bool, int, double, double, double>;
/// Mechanisms, parents, and rows of axis, offset, straight chord, length beyond and whether it bends within the
/// joint before it, of the joints at an end.
using Joints = std::tuple<std::vector<int>, std::vector<int>, std::vector<std::array<double, 7>>>;
using Described = std::tuple<Joints, Joints, double, std::vector<std::vector<Passage>>>;

int read_joints(const Joints& joints, ChainJoint<double>* out) {
  const auto& [mechanisms, parents, numbers] = joints;
  const std::size_t count = mechanisms.size();
  require(count <= std::size_t(most_joints) && parents.size() == count && numbers.size() == count,
          "a chain has too many joints at an end");
  for (std::size_t i = 0; i < count; ++i) {
    require(mechanisms[i] >= 0 && mechanisms[i] <= int(Mechanism::continuum), "there is no such mechanism");
    require(parents[i] >= -1 && std::cmp_less(parents[i], i), "a joint stands on one before it");
    const auto& [x, y, z, offset, chord, length, within] = numbers[i];
    out[i].mechanism = static_cast<Mechanism>(mechanisms[i]);
    out[i].parent = parents[i];
    out[i].axis = {x, y, z};
    out[i].offset = offset;
    out[i].chord = chord;
    out[i].length = length;
    out[i].within = within != 0;
    require(!out[i].within || (i > 0 && parents[i] == int(i) - 1), "a joint bends within the one that it stands on");
  }
  return int(count);
}

/// A chain with the routes of its tendons.
struct BoundChain {
  Described described;
  AnyChain chain{};

  explicit BoundChain(const Described& of) : described(of) {
    const auto& [tip, handle, stem, routes] = of;
    chain.joints = read_joints(tip, chain.tip);
    chain.handles = read_joints(handle, chain.handle);
    chain.stem_length = stem;
    require(chain.joints > 0, "a chain has a joint at the tip");
    for (const auto& route : routes)
      for (const auto& [at_tip, joint, x, y, z] : route)
        require(joint >= 0 && joint < (at_tip ? chain.joints : chain.handles), "a tendon crosses joints of the chain");
  }
  const std::vector<std::vector<Passage>>& routes() const { return std::get<3>(described); }
  std::size_t joints() const { return std::size_t(chain.joints); }
  std::size_t handles() const { return std::size_t(chain.handles); }
  std::size_t tip_columns() const { return own_columns + joints(); }
  std::size_t row_length() const { return tip_columns() + handles(); }
  std::size_t frames() const { return 1 + tip_frames * joints() + handle_frames * handles(); }
};

At posture_of(const BoundChain& bound, const double* row) {
  At at{row[0], row[1], row[2], row[3], {}, row[4 + bound.joints()], {}};
  std::copy_n(row + 4, bound.joints(), at.bend);
  std::copy_n(row + bound.tip_columns(), bound.handles(), at.handle);
  return at;
}

void write(const Frame<double>& frame, double* out) {
  const auto& [p, r] = frame;
  // Of a rotation's two quaternions, the one whose first component is not negative.
  const double sign = r.w < 0 ? -1 : 1;
  const double values[frame_length] = {p.x, p.y, p.z, sign * r.w, sign * r.x, sign * r.y, sign * r.z};
  std::copy_n(values, frame_length, out);
}

void write_frames(const BoundChain& bound, const Bodies<double, most_joints>& found, double* out) {
  const auto next = [&](const Frame<double>& frame) {
    write(frame, out);
    out += frame_length;
  };
  next(found.stem);
  for (std::size_t i = 0; i < bound.joints(); ++i) {
    next(found.tip[i].carrier);
    next(found.tip[i].far);
    next(found.end_effector[i]);
    next(found.end[i]);
  }
  for (std::size_t i = 0; i < bound.handles(); ++i) {
    next(found.handle[i].carrier);
    next(found.handle[i].far);
    next(found.grip[i]);
  }
}

void check_rows(const BoundChain& bound, const In<2>& rows, std::size_t written) {
  require(rows.shape(1) == bound.row_length() && rows.shape(0) == written, "arrays do not fit");
}

void frames(const BoundChain& bound, const In<2>& rows, const Out<3>& out, int threads) {
  check_rows(bound, rows, out.shape(0));
  const std::size_t length = bound.row_length(), count = bound.frames();
  require(out.shape(1) == count && out.shape(2) == frame_length, "out does not fit the chain");
  const nb::gil_scoped_release release;
  over_threads(rows.shape(0), threads, points_per_thread, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < std::min(end, rows.shape(0)); ++i)
      write_frames(bound, bodies(bound.chain, posture_of(bound, rows.data() + i * length)),
                   out.data() + i * count * frame_length);
  });
}

void jacobians(const BoundChain& bound, const In<2>& rows, const std::vector<int>& ends, const Out<4>& out,
               int threads) {
  check_rows(bound, rows, out.shape(0));
  const std::size_t columns = bound.tip_columns();
  require(out.shape(1) == ends.size() && out.shape(2) == 6 && out.shape(3) == columns, "out does not fit");
  for (const int end : ends) require(end >= 0 && end < bound.chain.joints, "an end is beyond a joint of the tip");
  const nb::gil_scoped_release release;
  over_threads(rows.shape(0), threads, points_per_thread / 8, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < std::min(end, rows.shape(0)); ++i) {
      const At at = posture_of(bound, rows.data() + i * bound.row_length());
      for (std::size_t e = 0; e < ends.size(); ++e) {
        const auto found = jacobian(bound.chain, at, ends[e]);
        double* to = out.data() + (i * ends.size() + e) * 6 * columns;
        for (std::size_t k = 0; k < columns; ++k) {
          const auto &v = found.linear[k], &w = found.angular[k];
          const double column[6] = {v.x, v.y, v.z, w.x, w.y, w.z};
          for (std::size_t j = 0; j < 6; ++j) to[j * columns + k] = column[j];
        }
      }
    }
  });
}

void inverses(const BoundChain& bound, const In<2>& goals, const In<2>& start, const Out<2>& out, const Statuses& reach,
              int threads) {
  const std::size_t count = goals.shape(0), columns = bound.tip_columns();
  require(goals.shape(1) == frame_length && out.shape(0) == count && out.shape(1) == columns &&
              start.shape(0) == count && start.shape(1) == 3 && reach.shape(0) == count,
          "arrays do not fit");
  const nb::gil_scoped_release release;
  over_threads(count, threads, points_per_thread / 8, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < std::min(end, count); ++i) {
      const double* g = goals.data() + i * frame_length;
      const double* t = start.data() + i * 3;
      const auto found = inverse(bound.chain, Frame<double>{{g[0], g[1], g[2]}, {g[3], g[4], g[5], g[6]}}, t[0],
                                 std::isnan(t[1]) ? Start<double>{} : Start<double>{true, t[1], t[2]});
      const At& at = found.posture;
      double* to = out.data() + i * columns;
      const double own[4] = {at.pan, at.tilt, at.spin, at.insertion};
      std::copy_n(own, 4, to);
      std::copy_n(at.bend, bound.joints(), to + 4);
      to[columns - 1] = at.roll;
      if (found.reach != Reach::ok) std::fill_n(to, columns, nan);
      reach.data()[i] = static_cast<unsigned char>(found.reach);
    }
  });
}

/// A joint as a line runs over it, from its end on the stem's side; side is -1 where it points to the handle. The joint
/// that it bends within, and that one's angle, if there is one.
struct Passed {
  const ChainJoint<double>& joint;
  Frame<double> near;
  double angle{};
  int side{};
  const ChainJoint<double>* around{};
  double around_angle{};

  /// The far end with a share of the bend.
  Frame<double> far(double share) const {
    if (around == nullptr) return bent(near, joint, share * angle, side).far;
    return bent_within(bent(near, *around, share * around_angle, side), *around, share * around_angle, joint,
                       share * angle)
        .far;
  }
};

/// Points along a tendon at one joint: both ends of a gear pair's, or enough of an arc to look like one; none at a
/// joint with another within it.
std::size_t points_over(const BoundChain& bound, bool at_tip, int i) {
  const ChainJoint<double>& joint = at_tip ? bound.chain.tip[i] : bound.chain.handle[i];
  const std::size_t points = joint.mechanism == Mechanism::gear ? 2 : 9;
  return at_tip && is_around(bound.chain, i) ? 0 : points;
}

/// Places the points of a line over a joint at an offset from its middle, outward.
template <class Place>
void over(const Passed& passed, std::size_t points, const Vector<double>& offset, bool ends, const Place& place) {
  const auto& [joint, near, angle, side, around, around_angle] = passed;
  const std::size_t last = points - 1;
  // On a pulley where it ends, a tendon wraps from the stem's side by a quarter turn while the joint is straight.
  const double toward = dot(bend_side(joint.axis), offset);
  const double quarter = ends && toward != 0 ? (toward < 0 ? -0.5 : 0.5) * side * pi : 0;
  for (std::size_t k = 0; k < points; ++k) {
    const double share = double(k) / double(last);
    if (joint.mechanism == Mechanism::pulley) {
      place(near.position + near.rotation * (about(joint.axis, share * (angle - quarter)) * offset));
      continue;
    }
    // A part of an arc is an arc of its own; a gear pair has only two ends.
    const Frame<double> far = passed.far(share);
    place(near.position + share * (far.position - near.position) + far.rotation * offset);
  }
}

/// Lengths of the lines: of every tendon, and of every backbone, of the tip's joints and then of the handle's.
std::vector<std::size_t> line_lengths(const BoundChain& bound) {
  const AnyChain& chain = bound.chain;
  std::vector<std::size_t> lengths;
  for (const auto& route : bound.routes()) {
    std::size_t points = std::get<0>(route.front()) ? 1 : 0;
    for (const auto& [at_tip, joint, x, y, z] : route) points += points_over(bound, at_tip, joint);
    lengths.push_back(points);
  }
  const auto backbones = [&](bool at_tip, const ChainJoint<double>* joints, int count) {
    for (int i = 0; i < count; ++i)
      if (joints[i].mechanism == Mechanism::continuum && points_over(bound, at_tip, i) > 0)
        lengths.push_back(points_over(bound, at_tip, i));
  };
  backbones(true, chain.tip, chain.joints);
  backbones(false, chain.handle, chain.handles);
  return lengths;
}

/// Tendons from the handle's end to the tip, and backbones outward; a tendon without a joint at the handle begins at
/// the stem's end there.
void write_lines(const BoundChain& bound, const At& at, double* out) {
  const AnyChain& chain = bound.chain;
  const Bodies<double, most_joints> found = bodies(chain, at);
  const Frame<double> bottom = found.stem.moved(-chain.stem_length);
  const auto place = [&](const Vector<double>& point) {
    const double coordinates[3] = {point.x, point.y, point.z};
    out = std::copy_n(coordinates, 3, out);
  };
  const auto passed = [&](bool at_tip, int i) {
    if (at_tip) {
      const bool within = is_within(chain, i);
      const ChainJoint<double>& joint = chain.tip[i];
      const ChainJoint<double>& first = chain.tip[within ? i - 1 : i];
      const Frame<double>& on = first.parent < 0 ? found.stem : found.tip[first.parent].far;
      return Passed{joint, on.moved(first.offset),    at.bend[i],
                    1,     within ? &first : nullptr, within ? at.bend[i - 1] : 0};
    }
    const ChainJoint<double>& joint = chain.handle[i];
    return Passed{joint, (i == 0 ? bottom : found.handle[i - 1].far).moved(-joint.offset), at.handle[i], -1};
  };
  for (const auto& route : bound.routes()) {
    for (std::size_t k = 0; k < route.size(); ++k) {
      const auto& [at_tip, joint, x, y, z] = route[k];
      const Vector<double> offset{x, y, z};
      if (at_tip) {
        if (k == 0) place(bottom.position + bottom.rotation * offset);
        over(passed(true, joint), points_over(bound, true, joint), offset, k + 1 == route.size(), place);
        continue;
      }
      std::vector<Vector<double>> points;
      over(passed(false, joint), points_over(bound, false, joint), offset, k == 0,
           [&](const Vector<double>& point) { points.push_back(point); });
      std::ranges::for_each(std::views::reverse(points), place);
    }
  }
  const auto backbones = [&](bool at_tip, int count) {
    for (int i = 0; i < count; ++i) {
      const Passed joint = passed(at_tip, i);
      if (joint.joint.mechanism == Mechanism::continuum) over(joint, points_over(bound, at_tip, i), {}, false, place);
    }
  };
  backbones(true, chain.joints);
  backbones(false, chain.handles);
}

void lines(const BoundChain& bound, const In<2>& rows, const Out<3>& out) {
  check_rows(bound, rows, out.shape(0));
  std::size_t points = 0;
  for (const std::size_t length : line_lengths(bound)) points += length;
  require(out.shape(1) == points && out.shape(2) == 3, "out does not fit the chain");
  const nb::gil_scoped_release release;
  for (std::size_t i = 0; i < rows.shape(0); ++i)
    write_lines(bound, posture_of(bound, rows.data() + i * bound.row_length()), out.data() + i * points * 3);
}

}  // namespace

void bind_kinematics(nb::module_& m) {
  nb::enum_<Reach>(m, "Reach", nb::is_arithmetic(), "How an inverse ended.")
      .value("OK", Reach::ok, "solved")
      .value("UNREACHABLE", Reach::unreachable, "no posture brings the tip there")
      .value("SINGULAR", Reach::singular, "two joints turn about one axis there")
      .value("NOT_FINITE", Reach::not_finite, "NaN or infinite input")
      .value("OTHER_JOINTS", Reach::other_joints, "not one or two joints, across the stem and each other");

  nb::class_<BoundChain>(m, "Chain", "The kinematic chain, with the routes of its tendons; lengths in m.")
      .def(
          "__init__",
          [](BoundChain* self, const Joints& tip, const Joints& handle, double stem_length,
             const std::vector<std::vector<Passage>>& routes) {
            new (self) BoundChain(Described{tip, handle, stem_length, routes});
          },
          "tip"_a, "handle"_a, "stem_length"_a, "routes"_a,
          "Joints from the stem outward: mechanisms, parents, and rows of axis, offset, straight chord, length beyond. "
          "Routes of tendons: whether a joint is at the tip, its place there, the tendon's offset from its middle.")
      .def_prop_ro("line_lengths", &line_lengths, "Points of every tendon and of every backbone, tip first.");

  m.def(
      "joint_lengths",
      [](const Spec& spec) {
        return std::visit(
            [](const auto& axis) { return std::make_tuple(axis.distal.chord(0.0), axis.proximal.chord(0.0)); },
            make_axis(spec));
      },
      "spec"_a, "Lengths of the straight joints, distal and proximal, m.");
  m.def(
      "chain_frames", &frames, "chain"_a, "rows"_a, "out"_a, "threads"_a,
      "Write the frames of all bodies: stem; carrier, far, end-effector and end of the tip's joints; carrier, far and "
      "grip of the handle's.");
  m.def("chain_jacobian", &jacobians, "chain"_a, "rows"_a, "ends"_a, "out"_a, "threads"_a,
        "Write the Jacobians of the ends beyond joints of the tip.");
  m.def(
      "chain_inverse", &inverses, "chain"_a, "goals"_a, "start"_a, "out"_a, "reach"_a, "threads"_a,
      "Write the coordinates that bring the tip to its goals, and how each solve ended; start: spin, and pan and tilt "
      "to start from, NaN for none.");
  m.def("chain_lines", &lines, "chain"_a, "rows"_a, "out"_a, "Write the points of all tendons and backbones.");
}

}  // namespace tenodesis::bindings

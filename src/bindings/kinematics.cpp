// Kinematics for Python: rows of joint coordinates in, frames, Jacobians and coordinates out.

#include "tenodesis/kinematics.hpp"

#include <cmath>
#include <string>
#include <tuple>
#include <variant>
#include <vector>

#include "evaluate.hpp"
#include "module.hpp"

namespace tenodesis::bindings {
namespace {

using namespace engine;

using AnyChain = std::variant<Chain<GearAxis<double>>, Chain<PulleyAxis<double>>, Chain<ContinuumAxis<double>>>;

// A row of coordinates: pan, tilt, spin, insertion, bends, roll, handle angles.
constexpr std::size_t row_length = std::size_t(Posture<double>::coordinates) + most_axes;
constexpr std::size_t frame_length = 7;  // x, y, z; w, x, y, z
constexpr std::size_t tip_coordinates = std::size_t(Posture<double>::coordinates);

/// Points along a tendon at one joint: both ends of a gear pair's, or enough of an arc to look like one.
template <class J>
constexpr std::size_t points_over = 9;
template <>
constexpr std::size_t points_over<TendonGear<double>> = 2;

using Described = std::tuple<std::vector<Spec>, std::vector<bool>, double, double, double>;

AnyChain make_chain(const Described& of) {
  const auto& [specs, pitches, stem, spacing, handle_spacing] = of;
  if (specs.empty() || specs.size() > std::size_t(most_axes) || pitches.size() != specs.size())
    throw nb::value_error("a chain has one or two axes");
  return std::visit(
      [&](const auto& first) -> AnyChain {
        using A = std::remove_cvref_t<decltype(first)>;
        Chain<A> chain{};
        chain.axes = int(specs.size());
        for (std::size_t i = 0; i < specs.size(); ++i) {
          const AnyAxis<double> any = make_axis(specs[i]);
          if (!std::holds_alternative<A>(any)) throw nb::value_error("axes differ in joint type");
          chain.axis[i] = std::get<A>(any);
          chain.direction[i] = pitches[i] ? Direction::pitch : Direction::yaw;
        }
        chain.stem_length = stem;
        chain.joint_spacing = spacing;
        chain.handle_joint_spacing = handle_spacing;
        return chain;
      },
      make_axis(specs[0]));
}

/// A chain with its description.
struct BoundChain {
  Described described;
  AnyChain chain;

  explicit BoundChain(const Described& of) : described(of), chain(make_chain(of)) {}
};

Posture<double> posture_of(const double* row) {
  return {row[0], row[1], row[2], row[3], {row[4], row[5]}, row[6], {row[7], row[8]}};
}

/// The same, where handle angles that are NaN follow the output without a load.
template <class A>
Posture<double> with_handle(const Chain<A>& chain, const double* row) {
  Posture<double> at = posture_of(row);
  for (int i = 0; i < chain.axes; ++i) {
    if (!std::isnan(at.handle[i])) continue;
    const Result<double> follows = unloaded_handle(chain, i, at.bend[i]);
    at.handle[i] = follows.status == Status::ok ? follows.value : nan;
  }
  return at;
}

void write(const Frame<double>& frame, double* out) {
  const auto& [p, r] = frame;
  // Of a rotation's two quaternions, the one whose first component is not negative.
  const double sign = r.w < 0 ? -1 : 1;
  const double values[frame_length] = {p.x, p.y, p.z, sign * r.w, sign * r.x, sign * r.y, sign * r.z};
  std::copy_n(values, frame_length, out);
}

/// Names of the frames, in the order they are written in.
template <class A>
std::vector<std::string> frame_names(const Chain<A>& chain) {
  std::vector<std::string> names{"stem"};
  const auto add = [&](const std::string& end) {
    for (int i = 0; i < chain.axes; ++i) {
      const std::string name = end + (chain.direction[i] == Direction::yaw ? "yaw" : "pitch");
      names.push_back(name + "_carrier");
      names.push_back(name + "_far");
    }
  };
  add("");
  names.insert(names.end(), {"end_effector", "tip"});
  add("handle_");
  names.emplace_back("grip");
  return names;
}

template <class A>
void write_frames(const Chain<A>& chain, const Bodies<double>& found, double* out) {
  const auto next = [&](const Frame<double>& frame) {
    write(frame, out);
    out += frame_length;
  };
  next(found.stem);
  for (int i = 0; i < chain.axes; ++i) {
    next(found.carrier[i]);
    next(found.far[i]);
  }
  next(found.end_effector);
  next(found.tip);
  for (int i = 0; i < chain.axes; ++i) {
    next(found.handle_carrier[i]);
    next(found.handle_far[i]);
  }
  next(found.grip);
}

void check_rows(const In<2>& rows, std::size_t length, std::size_t written) {
  if (rows.shape(1) != length || rows.shape(0) != written) throw nb::value_error("arrays do not fit");
}

void frames(const BoundChain& bound, const In<2>& rows, const Out<3>& out, int threads) {
  check_rows(rows, row_length, out.shape(0));
  std::visit(
      [&](const auto& chain) {
        if (out.shape(1) != frame_names(chain).size() || out.shape(2) != frame_length)
          throw nb::value_error("out does not fit the chain");
        const nb::gil_scoped_release release;
        over_threads(rows.shape(0), threads, points_per_thread, [&](std::size_t begin, std::size_t end) {
          for (std::size_t i = begin; i < std::min(end, rows.shape(0)); ++i)
            write_frames(chain, bodies(chain, with_handle(chain, rows.data() + i * row_length)),
                         out.data() + i * out.shape(1) * frame_length);
        });
      },
      bound.chain);
}

void tip(const BoundChain& bound, const In<2>& rows, const Out<2>& out, int threads) {
  check_rows(rows, row_length, out.shape(0));
  if (out.shape(1) != frame_length) throw nb::value_error("out does not fit");
  const nb::gil_scoped_release release;
  std::visit(
      [&](const auto& chain) {
        over_threads(rows.shape(0), threads, points_per_thread, [&](std::size_t begin, std::size_t end) {
          for (std::size_t i = begin; i < std::min(end, rows.shape(0)); ++i)
            write(bodies(chain, posture_of(rows.data() + i * row_length)).tip, out.data() + i * frame_length);
        });
      },
      bound.chain);
}

void jacobians(const BoundChain& bound, const In<2>& rows, const Out<3>& out, int threads) {
  check_rows(rows, row_length, out.shape(0));
  if (out.shape(1) != 6 || out.shape(2) != tip_coordinates) throw nb::value_error("out does not fit");
  const nb::gil_scoped_release release;
  std::visit(
      [&](const auto& chain) {
        over_threads(rows.shape(0), threads, points_per_thread / 8, [&](std::size_t begin, std::size_t end) {
          for (std::size_t i = begin; i < std::min(end, rows.shape(0)); ++i) {
            const Jacobian<double> found = jacobian(chain, posture_of(rows.data() + i * row_length));
            double* at = out.data() + i * 6 * tip_coordinates;
            for (std::size_t k = 0; k < tip_coordinates; ++k) {
              const auto &v = found.linear[k], &w = found.angular[k];
              const double column[6] = {v.x, v.y, v.z, w.x, w.y, w.z};
              for (std::size_t j = 0; j < 6; ++j) at[j * tip_coordinates + k] = column[j];
            }
          }
        });
      },
      bound.chain);
}

void inverses(const BoundChain& bound, const In<2>& goals, const In<2>& start, const Out<2>& out, const Statuses& reach,
              int threads) {
  check_rows(goals, frame_length, out.shape(0));
  const std::size_t count = goals.shape(0);
  if (out.shape(1) != tip_coordinates || start.shape(0) != count || start.shape(1) != 3 || reach.shape(0) != count)
    throw nb::value_error("arrays do not fit");
  const nb::gil_scoped_release release;
  std::visit(
      [&](const auto& chain) {
        over_threads(count, threads, points_per_thread / 8, [&](std::size_t begin, std::size_t end) {
          for (std::size_t i = begin; i < std::min(end, count); ++i) {
            const double* g = goals.data() + i * frame_length;
            const double* t = start.data() + i * 3;
            const Reached<double> found =
                inverse(chain, Frame<double>{{g[0], g[1], g[2]}, {g[3], g[4], g[5], g[6]}}, t[0],
                        std::isnan(t[1]) ? Start<double>{} : Start<double>{true, t[1], t[2]});
            const Posture<double>& at = found.posture;
            const double row[tip_coordinates] = {at.pan,     at.tilt,    at.spin, at.insertion,
                                                 at.bend[0], at.bend[1], at.roll};
            for (std::size_t k = 0; k < tip_coordinates; ++k)
              out.data()[i * tip_coordinates + k] = found.reach == Reach::ok ? row[k] : nan;
            reach.data()[i] = static_cast<unsigned char>(found.reach);
          }
        });
      },
      bound.chain);
}

/// A tendon's path over a joint: the joint's near end, its angle, and the tendon's offset from its middle.
struct Path {
  Frame<double> near;
  Direction direction{};
  double angle{};
  int side{};  // -1 where the joint points to the handle
  Vector<double> offset;
  bool own{};  // whether the tendon bends this joint and ends at it, or passes through its middle plane
};

/// Places the points of one tendon over one joint, from the near end to the far end.
template <class J, class Place>
void over(const J& joint, const Path& path, const Place& place) {
  constexpr std::size_t points = points_over<J>;
  for (std::size_t k = 0; k < points; ++k) {
    // A part of an arc is an arc of its own; a gear pair has only two ends.
    const double share = double(k) / double(points - 1);
    Frame<double> carrier, far;
    detail::pass(path.near, joint, path.direction, share * path.angle, path.side, carrier, far);
    const Vector<double> middle = path.near.position + share * (far.position - path.near.position);
    place(middle + far.rotation * path.offset);
  }
}

/// On a pulley the tendon wraps from the stem's side to its end, a quarter turn when the joint is straight.
template <class Place>
void over(const TendonPulley<double>&, const Path& path, const Place& place) {
  constexpr std::size_t points = points_over<TendonPulley<double>>;
  const double sign = path.offset.x + path.offset.y < 0 ? -1 : 1;
  const double wrap = path.own ? 0.5 * pi - sign * path.side * path.angle : 0;
  for (std::size_t k = 0; k < points; ++k) {
    const double angle = -sign * path.side * wrap * double(k) / double(points - 1);
    place(path.near.position + path.near.rotation * (bend(path.direction, angle) * path.offset));
  }
}

template <class A>
std::size_t path_length(const Chain<A>& chain) {
  using Proximal = std::remove_cvref_t<decltype(chain.axis[0].proximal)>;
  using Distal = std::remove_cvref_t<decltype(chain.axis[0].distal)>;
  return std::size_t(chain.axes) * (points_over<Proximal> + points_over<Distal>);
}

/// Two tendons of every axis, agonist first, from the handle to their ends; the points of a tendon that ends before the
/// last joint repeat its end.
template <class A>
void write_paths(const Chain<A>& chain, const Posture<double>& at, double* out) {
  const Bodies<double> found = bodies(chain, at);
  const std::size_t length = path_length(chain);
  for (int axis = 0; axis < chain.axes; ++axis) {
    for (const double sign : {1.0, -1.0}) {
      std::vector<Vector<double>> points;
      const auto place = [&](const Vector<double>& point) { points.push_back(point); };
      const auto offset = [&](double radius) {
        return chain.direction[axis] == Direction::yaw ? Vector<double>{sign * radius, 0, 0}
                                                       : Vector<double>{0, sign * radius, 0};
      };
      for (int i = 0; i <= axis; ++i) {
        const Frame<double> near =
            i == 0 ? found.stem.moved(-chain.stem_length) : found.handle_far[i - 1].moved(-chain.handle_joint_spacing);
        over(chain.axis[i].proximal,
             Path{near, chain.direction[i], at.handle[i], -1, offset(chain.axis[axis].proximal.radius), i == axis},
             place);
      }
      std::ranges::reverse(points);
      for (int i = 0; i <= axis; ++i) {
        const Frame<double> near = i == 0 ? found.stem : found.far[i - 1].moved(chain.joint_spacing);
        over(chain.axis[i].distal,
             Path{near, chain.direction[i], at.bend[i], 1, offset(chain.axis[axis].distal.radius), i == axis}, place);
      }
      points.resize(length, points.back());
      for (const Vector<double>& point : points) {
        const double coordinates[3] = {point.x, point.y, point.z};
        out = std::copy_n(coordinates, 3, out);
      }
    }
  }
}

void tendon_paths(const BoundChain& bound, const In<2>& rows, const Out<3>& out) {
  check_rows(rows, row_length, out.shape(0));
  std::visit(
      [&](const auto& chain) {
        const std::size_t points = 2 * std::size_t(chain.axes) * path_length(chain);
        if (out.shape(1) != points || out.shape(2) != 3) throw nb::value_error("out does not fit the chain");
        const nb::gil_scoped_release release;
        for (std::size_t i = 0; i < rows.shape(0); ++i)
          write_paths(chain, with_handle(chain, rows.data() + i * row_length), out.data() + i * points * 3);
      },
      bound.chain);
}

}  // namespace

void bind_kinematics(nb::module_& m) {
  nb::enum_<Reach>(m, "Reach", nb::is_arithmetic(), "How an inverse ended.")
      .value("OK", Reach::ok, "solved")
      .value("UNREACHABLE", Reach::unreachable, "no posture brings the tip there")
      .value("SINGULAR", Reach::singular, "two joints turn about one axis there")
      .value("NOT_FINITE", Reach::not_finite, "NaN or infinite input");

  nb::class_<BoundChain>(m, "Chain", "The kinematic chain: axes from the stem outward, and lengths between them, m.")
      .def(
          "__init__",
          [](BoundChain* self, const std::vector<Spec>& specs, const std::vector<bool>& pitches, double stem_length,
             double joint_spacing, double handle_joint_spacing) {
            new (self) BoundChain(Described{specs, pitches, stem_length, joint_spacing, handle_joint_spacing});
          },
          "specs"_a, "pitches"_a, "stem_length"_a, "joint_spacing"_a, "handle_joint_spacing"_a)
      .def_prop_ro(
          "frame_names",
          [](const BoundChain& bound) {
            return std::visit([](const auto& chain) { return frame_names(chain); }, bound.chain);
          },
          "Names of the frames, in their order.")
      .def_prop_ro(
          "path_length",
          [](const BoundChain& bound) {
            return std::visit([](const auto& chain) { return path_length(chain); }, bound.chain);
          },
          "Points that a tendon is drawn with.");

  m.def(
      "joint_lengths",
      [](const Spec& spec) {
        return std::visit(
            [](const auto& axis) { return std::make_tuple(chord(axis.distal, 0.0), chord(axis.proximal, 0.0)); },
            make_axis(spec));
      },
      "spec"_a, "Lengths of the straight joints, distal and proximal, m.");
  m.def("chain_frames", &frames, "chain"_a, "rows"_a, "out"_a, "threads"_a, "Write the frames of all bodies.");
  m.def("chain_tip", &tip, "chain"_a, "rows"_a, "out"_a, "threads"_a, "Write the frame of the tip.");
  m.def("chain_jacobian", &jacobians, "chain"_a, "rows"_a, "out"_a, "threads"_a, "Write the tip's Jacobian.");
  m.def(
      "chain_inverse", &inverses, "chain"_a, "goals"_a, "start"_a, "out"_a, "reach"_a, "threads"_a,
      "Write the coordinates that bring the tip to its goals, and how each solve ended; start: spin, and pan and tilt "
      "to start from, NaN for none.");
  m.def("chain_paths", &tendon_paths, "chain"_a, "rows"_a, "out"_a, "Write the points of all tendons.");
}

}  // namespace tenodesis::bindings

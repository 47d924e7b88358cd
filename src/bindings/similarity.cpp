// Many scale models of one instrument, evaluated over the same points of its working range.

#include "tenodesis/similarity.hpp"

#include <string>

#include "evaluate.hpp"
#include "module.hpp"

namespace tenodesis::bindings {
namespace {

using namespace engine;

/// Results of a scale model.
enum Finding : std::size_t {
  largest_error,  // rad, over the points where the instrument has an equilibrium; a snapped tip is at its stop
  rms_error,      // rad, likewise
  snapped,        // share of the points at which the scale model snaps through
  force_scale,
  scaled_pretension,  // N, as given or as scaled
  model_stiffness,    // N/m, of one tendon
  largest_tension,    // N, including tips that have snapped through
  tension_per_tip_force,
  rig_lever,  // m
  unloaded_share,
  joints_span,  // m, of tendon within both straight joints
  finding_count,
};

inline constexpr std::array<const char*, finding_count> finding_names{
    "largest_error",   "rms_error",         "snapped", "force_factor",   "pretension", "tendon_stiffness",
    "largest_tension", "tension_per_force", "rig_arm", "unloaded_limit", "joints_span"};
static_assert(finding_names.back() != nullptr, "every finding has a name");

/// An instrument, the points at which its scale models are evaluated, and its own output angles there.
struct Target {
  Spec spec;
  std::vector<double> handle, force, expected;  // rad, N, rad
  double at_angle{};                            // output angle at which the loss of dexterity is equal, rad
  double stop{};                                // output angle of the mechanical stop, rad
};

double tension_scale_of(const Spec& spec) {
  return std::visit([](const auto& axis) { return tension_scale(axis); }, make_axis(spec));
}

/// Output angles of the instrument at the points, where it must have an equilibrium.
std::vector<double> held_angles(const Spec& spec, const std::vector<double>& handle, const std::vector<double>& force) {
  require(handle.size() == force.size(), "handle angles and forces differ in number");
  std::vector<double> angles(handle.size());
  std::visit(
      [&](const auto& axis) {
        for (std::size_t i = 0; i < angles.size(); ++i) {
          const auto at = equilibrium(axis, handle[i], Load<double>{force[i], 0}, Stroke<double>{});
          if (at.status != Status::ok) throw nb::value_error("there is no equilibrium at a point");
          angles[i] = axis.distal.angle(at.coordinate);
        }
      },
      make_axis(spec));
  return angles;
}

template <class A>
void judge_over_points(const Target& target, const A& axis, double factor, double* out) {
  Block block;
  std::array<unsigned char, block_size> status{};
  for (Lane& lane : block.in) lane.fill(0);
  double largest = 0, squares = 0, tension = 0, lost = 0;
  const double rate = axis.stiffness * axis.distal.excursion_slope();
  for (std::size_t base = 0; base < target.handle.size(); base += block_size) {
    // The last block is filled up with valid points of the previous one.
    const std::size_t n = std::min<std::size_t>(block_size, target.handle.size() - base);
    for (std::size_t i = 0; i < n; ++i) {
      block.in[held_handle_angle][i] = target.handle[base + i];
      block.in[held_force][i] = target.force[base + i] * factor;
    }
    solve_block<HeldState>(axis, block, status);
    for (std::size_t i = 0; i < n; ++i) {
      const bool held = status[i] == static_cast<unsigned char>(Status::ok);
      const double stop = target.force[base + i] > 0 ? -target.stop : target.stop;
      const double error = std::abs((held ? block.out[0][i] : stop) - target.expected[base + i]);
      largest = std::max(largest, error);
      squares += error * error;
      lost += held ? 0 : 1;
      const Tensions<double> pulled =
          held ? Tensions<double>{block.out[1][i], block.out[2][i]}
               : TendonPair<double>{block.agonist[i], block.antagonist[i], rate}.tensions(axis.distal.coordinate(stop));
      tension = std::max({tension, pulled.agonist, pulled.antagonist});
    }
  }
  const auto count = double(target.handle.size());
  out[largest_error] = largest;
  out[rms_error] = std::sqrt(squares / count);
  out[snapped] = lost / count;
  out[largest_tension] = tension;
}

template <class A, class B>
void judge_one(const Target& target, const A& model, B axis, double pretension, double* out) {
  const double scaled = model.pretension * tension_scale(axis) / tension_scale(model);
  axis.pretension = std::isnan(pretension) ? scaled : pretension;
  const Result<double> factor = force_factor(model, axis, target.at_angle);
  out[force_scale] = factor.status == Status::ok ? factor.value : nan;
  out[scaled_pretension] = axis.pretension;
  out[model_stiffness] = axis.stiffness;
  out[tension_per_tip_force] = tension_per_force(axis);
  out[rig_lever] = axis.distal.rig_arm();
  out[unloaded_share] = unloaded_limit(axis);
  out[joints_span] = axis.proximal.tendon_span() + axis.distal.tendon_span();
  judge_over_points(target, axis, factor.value, out);
}

/// Writes the findings of every row of parameters with the given pretensions; NaN scales the instrument's.
void judge_designs(const Target& target, const In<2>& rows, const In<1>& pretensions, const Out<2>& out, int threads) {
  require(rows.shape(1) == parameter_count && out.shape(1) == finding_count && out.shape(0) == rows.shape(0) &&
              pretensions.shape(0) == rows.shape(0),
          "rows, pretensions and findings do not fit");
  const std::size_t count = rows.shape(0);
  if (count == 0) return;
  const nb::gil_scoped_release release;
  const AnyAxis<double> any = make_axis(target.spec);
  constexpr std::size_t designs_per_thread = 128;
  over_threads(count, threads, designs_per_thread, [&](std::size_t begin, std::size_t end) {
    Spec spec = target.spec;
    for (std::size_t i = begin; i < end; ++i) {
      std::copy_n(rows.data() + i * parameter_count, parameter_count, spec.parameters.begin());
      const double pretension = pretensions.data()[i];
      double* const found = out.data() + i * finding_count;
      std::visit(
          [&]<class A>(const A& model) { judge_one(target, model, std::get<A>(make_axis(spec)), pretension, found); },
          any);
    }
  });
}

}  // namespace

void bind_similarity(nb::module_& m) {
  m.def("tension_scale", &tension_scale_of, "spec"_a, "Tension that stretches a tendon by the distal radius, N.");
  m.def("findings", [] { return list_of(finding_names); }, "Names of the findings of a scale model, in their order.");
  nb::class_<Target>(m, "SimilarityTarget", "An instrument, and the points at which its scale models are evaluated.")
      .def(
          "__init__",
          [](Target* self, const Spec& spec, std::vector<double> handle, std::vector<double> force, double at_angle,
             double stop) {
            std::vector<double> expected = held_angles(spec, handle, force);
            new (self) Target{spec, std::move(handle), std::move(force), std::move(expected), at_angle, stop};
          },
          "spec"_a, "handle_angle"_a, "force"_a, "at_angle"_a, "stop"_a)
      .def("judge", &judge_designs, "rows"_a, "pretension"_a, "out"_a, "threads"_a,
           "Write the findings of every row of parameters, by row and finding; NaN scales the pretension.");
}

}  // namespace tenodesis::bindings

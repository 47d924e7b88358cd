// Chains of joints that share tendons: statics over arrays.

#include <algorithm>
#include <cstring>

#include "chain_spec.hpp"
#include "evaluate.hpp"
#include "tenodesis/chain_block.hpp"

namespace tenodesis::bindings {

void ChainSpec::make() {
  bool found = false;
  const auto pick = [&]<class W>() {
    if (found || joints_ > std::size_t(W::joints) || tendons_ > std::size_t(W::tendons)) return;
    any_.template emplace<W>();
    found = true;
  };
  [&]<class... W>(std::variant<W...>*) { (pick.template operator()<W>(), ...); }(&any_);
}

namespace {

// Rows of tension (N) and stiffness over that at rest; those after the last entry have a tension of NaN.
StretchCurve<double> curve_of(const In<3>& growth, std::size_t m, double pretension) {
  StretchCurve<double> curve{};
  for (std::size_t k = 0; k < growth.shape(1); ++k) {
    const double* row = growth.data() + (m * growth.shape(1) + k) * 2;
    if (std::isnan(row[0])) break;
    curve.tension[k] = row[0];
    curve.ratio[k] = row[1];
    curve.entries = int(k) + 1;
  }
  if (curve.entries > 0) curve.rest_at(pretension);
  return curve;
}

}  // namespace

ChainSpec::ChainSpec(const std::vector<int>& mechanism, const std::vector<int>& parent, const In<2>& numbers,
                     const In<2>& arm, const In<2>& tendon, const std::vector<int>& motor,
                     const std::vector<int>& handle, const In<2>& handle_arm, const In<3>& growth)
    : joints_(mechanism.size()), tendons_(arm.shape(0)), handles_(handle.size()) {
  require(joints_ >= 1 && joints_ <= most_joints && tendons_ <= most_tendons && handles_ <= joints_ &&
              parent.size() == joints_ && numbers.shape(0) == joints_ && numbers.shape(1) == joint_numbers &&
              arm.shape(1) == joints_ && tendon.shape(0) == tendons_ && tendon.shape(1) == 2 &&
              motor.size() == tendons_ && handle_arm.shape(0) == tendons_ && handle_arm.shape(1) == handles_ &&
              (growth.shape(0) == 0 ||
               (growth.shape(0) == tendons_ && growth.shape(1) <= most_stretch_entries && growth.shape(2) == 2)),
          "joints, tendons and handle do not fit each other");
  make();
  std::visit(
      [&](auto& chain) {
        for (ChainJoint<double>& inert : chain.joint)
          inert = {.mechanism = Mechanism::pulley, .parent = -1, .axis = {1, 0, 0}, .stiffness = 1};
        for (std::size_t i = 0; i < joints_; ++i) {
          const double* row = numbers.data() + i * joint_numbers;
          require(std::cmp_less(parent[i], i), "a joint stands on one that comes after it");
          require(row[bends_within] == 0 || parent[i] == int(i) - 1, "a joint bends within the one that it stands on");
          require(row[tied_to] >= -1 && row[tied_to] < double(i), "a joint is tied to one that comes after it");
          chain.joint[i] = {Mechanism(mechanism[i]),
                            row[bends_within] != 0,
                            parent[i],
                            {row[axis_x], row[axis_y], row[axis_z]},
                            row[offset],
                            row[chord],
                            row[length],
                            row[stiffness],
                            row[hardening],
                            {row[tie_ratio], row[tie_stiffness], int(row[tied_to]), row[tie_is_rigid] != 0},
                            row[share],
                            row[grip]};
        }
        for (std::size_t m = 0; m < tendons_; ++m) {
          chain.stiffness[m] = tendon.data()[2 * m];
          chain.pretension[m] = tendon.data()[2 * m + 1];
          chain.motor[m] = motor[m] != 0;
          for (std::size_t i = 0; i < joints_; ++i) chain.arm[m][i] = arm.data()[m * joints_ + i];
          for (std::size_t h = 0; h < handles_; ++h) chain.handle_arm[m][h] = handle_arm.data()[m * handles_ + h];
          if (growth.shape(0) > 0) chain.curves.at[m] = curve_of(growth, m, chain.pretension[m]);
        }
        chain.handles = int(handles_);
        for (std::size_t h = 0; h < handles_; ++h) chain.handle[h] = Mechanism(handle[h]);
      },
      any_);
}

namespace {

/// Statics of a chain over arrays.
class AnyTendonChain : public ChainSpec {
 public:
  using ChainSpec::ChainSpec;

  /// Angles, tensions and status of every point.
  void solve(const In<2>& handle, const In<2>& stroke, const In<2>& wrench, const In<2>& grip, bool in_stem_axes,
             const Out<2>& angle, const Out<2>& tension, const Statuses& status, int threads) const {
    const Rows rows{handle, stroke, wrench, grip, in_stem_axes};
    check(rows, status);
    const nb::gil_scoped_release release;
    std::visit(
        [&](const auto& chain) {
          using W = std::decay_t<decltype(chain)>;
          const auto store = [&](std::size_t p, const Solved<W>& found, Status status_of) {
            const bool ok = status_of == Status::ok;
            for (std::size_t i = 0; i < joints(); ++i) angle.data()[p * joints() + i] = ok ? found.angle[i] : nan;
            for (std::size_t m = 0; m < tendons(); ++m) tension.data()[p * tendons() + m] = ok ? found.tension[m] : nan;
            status.data()[p] = static_cast<unsigned char>(status_of);
          };
          over_threads(status.shape(0), threads, 256, [&](std::size_t begin, std::size_t end) {
            Solved<W> found[block];
            for (std::size_t base = begin; base < end; base += block) {
              const std::size_t n = std::min(block, end - base);
              const std::uint32_t decided = solve_block(chain, rows, base, n, found);
              for (std::size_t k = 0; k < n; ++k) {
                const bool is_decided = (decided >> k & 1u) != 0;
                store(base + k, found[k], is_decided ? Status::ok : solve_alone(chain, rows, base + k, found[k]));
              }
            }
          });
        },
        any());
  }

  /// Rates of the angles: rows of joints by stiffness, wrench, grip, stroke, handle.
  void answer(const In<2>& handle, const In<2>& stroke, const In<2>& wrench, const In<2>& grip, bool in_stem_axes,
              const Out<3>& out, const Statuses& status, int threads) const {
    const std::size_t width = joints() + load_components + tendons() + handles();
    require(out.shape(1) == joints() && out.shape(2) == width, "rates do not fit the chain");
    each({handle, stroke, wrench, grip, in_stem_axes}, status, threads, [&](const auto& at, std::size_t p) {
      const auto found = tenodesis::solve(at.chain, at.wound, at.load);
      ChainAnswer<std::decay_t<decltype(at.chain)>> rates{};
      Status status_of = found.status;
      if (status_of == Status::ok)
        status_of = tenodesis::answer(at.chain, at.wound, at.load, at.handle, found.x, rates);
      for (std::size_t i = 0; i < joints(); ++i) {
        double* to = out.data() + (p * joints() + i) * width;
        if (status_of != Status::ok) {
          std::fill_n(to, width, nan);
          continue;
        }
        to = std::copy_n(rates.stiffness[i], joints(), to);
        to = std::copy_n(rates.by_wrench[i], 6, to);
        *to++ = rates.by_grip[i];
        to = std::copy_n(rates.by_stroke[i], tendons(), to);
        std::copy_n(rates.by_handle[i], handles(), to);
      }
      return status_of;
    });
  }

  void handle_angles(const In<2>& angle, const In<2>& stroke, const In<2>& wrench, const In<2>& grip, bool in_stem_axes,
                     const Out<2>& out, const Statuses& status, int threads) const {
    // The tip's angles stand in the place of the handle's.
    each({angle, stroke, wrench, grip, in_stem_axes}, status, threads, [&](const auto& at, std::size_t p) {
      double handle[std::decay_t<decltype(at.chain)>::joints]{};
      const Status found = tenodesis::handle_angles(at.chain, row(angle, p), at.load, at.stroke, handle);
      store(out, p, handles(), handle, found);
      return found;
    });
  }

  /// Lengths by which tendons are stretched more than at rest, m, at tensions, N.
  void stretches(const In<2>& tension, const Out<2>& out) const {
    each_tendon(tension, out, [](const auto& chain, int m, double at) {
      return (chain.linear_at(m, at) - chain.pretension[m]) / chain.stiffness[m];
    });
  }
  /// The inverse; negative where a tendon would have to push.
  void tensions(const In<2>& stretch, const Out<2>& out) const {
    each_tendon(stretch, out, [](const auto& chain, int m, double by) { return chain.stretched(m, by, 0.0); });
  }

  void compensation_strokes(const In<2>& handle, const In<2>& stroke, const In<2>& wrench, const In<2>& grip,
                            bool in_stem_axes, const Out<2>& out, const Statuses& status, int threads) const {
    each({handle, stroke, wrench, grip, in_stem_axes}, status, threads, [&](const auto& at, std::size_t p) {
      double strokes[std::decay_t<decltype(at.chain)>::tendons]{};
      const Status found = tenodesis::compensation_strokes(at.chain, at.wound, at.load, strokes);
      store(out, p, tendons(), strokes, found);
      return found;
    });
  }

  /// Moments about the joints by a unit of each component of a wrench in the tip's axes, of every point.
  void load_matrix(const In<2>& angle, const Out<3>& out) const {
    const std::size_t count = angle.shape(0);
    require(angle.shape(1) == joints() && out.shape(0) == count && out.shape(1) == joints() && out.shape(2) == 6,
            "angles do not fit the chain");
    std::visit(
        [&]<class W>(const W& chain) {
          for (std::size_t p = 0; p < count; ++p) {
            Bend<double> bend[W::joints];
            for (std::size_t i = 0; i < W::joints; ++i)
              bend[i] = Bend<double>(chain.joint[i],
                                     i < joints() ? coordinate_at(chain.joint[i].mechanism, row(angle, p)[i]) : 0.0);
            for (int k = 0; k < 6; ++k) {
              double wrench[6]{}, moment[W::joints], rate[W::joints][W::joints];
              wrench[k] = 1;
              chain.load_moments(bend, load_of(wrench, 0.0, false), moment, rate);
              for (std::size_t i = 0; i < std::min(joints(), std::size_t(W::joints)); ++i)
                out.data()[(p * joints() + i) * 6 + std::size_t(k)] = moment[i];
            }
          }
        },
        any());
  }

  /// The axis that a chain of one joint between a matched pair of tendons is, whose equilibria have a closed form;
  /// none for any other.
  nb::object closed_form(double handle_length, double handle_range) const {
    engine::Spec spec{{}, {}, handle_range};
    const bool is_axis = std::visit([&](const auto& chain) { return describe(chain, handle_length, spec); }, any());
    return is_axis ? nb::cast(spec) : nb::none();
  }

 private:
  static constexpr std::size_t block = 8;

  /// Inputs of all points.
  struct Rows {
    const In<2>& held;  ///< angles of the handle, or of the tip
    const In<2>& stroke;
    const In<2>& wrench;
    const In<2>& grip;
    bool in_stem_axes;
  };

  template <class T>
  static ChainLoad<T> load_of(const T* w, const T& grip, bool in_stem_axes) {
    return {{{w[0], w[1], w[2]}, {w[3], w[4], w[5]}}, grip, in_stem_axes};
  }

  /// Inputs of a point, in the chain's own sizes.
  template <class W>
  struct Point {
    const W& chain;
    double handle[W::joints]{};
    double stroke[W::tendons]{};
    double wound[W::tendons]{};
    ChainLoad<double> load{};

    Point(const W& of, const Rows& rows, std::size_t p, std::size_t handles, std::size_t tendons) : chain(of) {
      std::copy_n(row(rows.held, p), handles, handle);
      std::copy_n(row(rows.stroke, p), tendons, stroke);
      chain.wind(handle, stroke, wound);
      load = load_of(row(rows.wrench, p), *row(rows.grip, p), rows.in_stem_axes);
    }
  };

  static const double* row(const In<2>& rows, std::size_t p) {
    return rows.data() + (rows.shape(0) == 1 ? 0 : p) * rows.shape(1);
  }

  static void store(const Out<2>& out, std::size_t p, std::size_t count, const double* values, Status found) {
    for (std::size_t k = 0; k < count; ++k) out.data()[p * count + k] = found == Status::ok ? values[k] : nan;
  }

  /// Angles (rad) and tensions (N) of a point.
  template <class W>
  struct Solved {
    double angle[W::joints]{};
    double tension[W::tendons]{};
  };

  template <class W>
  Status solve_alone(const W& chain, const Rows& rows, std::size_t p, Solved<W>& out) const {
    const Point<W> at(chain, rows, p, handles(), tendons());
    const auto found = tenodesis::solve(chain, at.wound, at.load);
    if (found.status != Status::ok) return found.status;
    double excursion[W::tendons];
    chain.excursions(found.x, excursion);
    for (int i = 0; i < W::joints; ++i) out.angle[i] = angle_at(chain.joint[i].mechanism, found.x[i]);
    for (int m = 0; m < W::tendons; ++m) out.tension[m] = std::max(chain.stretched(m, at.wound[m], excursion[m]), 0.0);
    return Status::ok;
  }

  // Solves n points from a place on. Bit k: whether the k-th is decided. Without wide vectors none is.
  template <class W>
  std::uint32_t solve_block([[maybe_unused]] const W& chain, [[maybe_unused]] const Rows& rows,
                            [[maybe_unused]] std::size_t base, [[maybe_unused]] std::size_t n,
                            [[maybe_unused]] Solved<W>* out) const {
    std::uint32_t decided = 0;
#if defined(__GNUC__)
    // Other sizes would cost more time to compile than they save.
    if constexpr (W::joints == 2 && W::tendons == 4) {
      if (!chain.is_linear()) return decided;
      const bool serial = chain.is_serial() && !rows.in_stem_axes;
      engine::in_wide_lanes([&](auto width) {
        constexpr std::size_t lanes = decltype(width)::value;
        using L = Lanes<double, int(lanes)>;
        for (std::size_t first = 0; first < n; first += lanes) {
          const std::size_t count = std::min(lanes, n - first);
          L handle[W::joints], stroke[W::tendons], wrench[6], grip, wound[W::tendons], excursion[W::tendons];
          // One number after another into a register would take longer than all that follows.
          const auto gather = [&](L* to, const In<2>& from, std::size_t columns) {
            for (std::size_t c = 0; c < columns; ++c) {
              double lane[lanes];
              // Lanes that are left over repeat the first point.
              for (std::size_t k = 0; k < lanes; ++k) lane[k] = row(from, base + first + (k < count ? k : 0))[c];
              std::memcpy(&to[c].v, lane, sizeof lane);
            }
          };
          gather(handle, rows.held, std::min<std::size_t>(handles(), W::joints));
          gather(stroke, rows.stroke, std::min<std::size_t>(tendons(), W::tendons));
          gather(wrench, rows.wrench, 6);
          gather(&grip, rows.grip, 1);
          chain.wind(handle, stroke, wound);
          const ChainLoad<L> all = load_of(wrench, grip, rows.in_stem_axes);
          const auto found = serial ? solve_lanes<true>(chain, wound, all) : solve_lanes(chain, wound, all);
          chain.excursions(found.x, excursion);
          for (int m = 0; m < W::tendons; ++m)
            excursion[m] = larger(chain.stretched(m, wound[m], excursion[m]), L(0.0));
          for (std::size_t k = 0; k < count; ++k) {
            decided |= std::uint32_t(found.decided[int(k)] > 0) << (first + k);
            for (int i = 0; i < W::joints; ++i) out[first + k].angle[i] = found.angle[i][int(k)];
            for (int m = 0; m < W::tendons; ++m) out[first + k].tension[m] = excursion[m][int(k)];
          }
        }
      });
    }
#endif
    return decided;
  }

  template <class W>
  bool describe(const W& chain, double handle_length, engine::Spec& spec) const {
    const auto& joint = chain.joint[0];
    const Mechanism handle = chain.handle[0];
    const bool bends = joint.mechanism == Mechanism::continuum;
    const auto opposite = [](double a, double b) { return a > 0 && a == -b; };
    if (joints() != 1 || tendons() != 2 || handles() != 1 || !opposite(chain.arm[0][0], chain.arm[1][0]) ||
        !opposite(chain.handle_arm[0][0], chain.handle_arm[1][0]) || chain.stiffness[0] != chain.stiffness[1] ||
        chain.pretension[0] != chain.pretension[1] || joint.axis.z != 0 || joint.share != 1 || joint.grip != 0 ||
        handle != (bends ? Mechanism::pulley : joint.mechanism) || (joint.stiffness > 0) != bends || !chain.is_linear())
      return false;
    auto& p = spec.parameters;
    p.fill(nan);
    spec.joint_type = engine::JointType(joint.mechanism);
    p[engine::proximal_radius] = chain.handle_arm[0][0] / excursion_slope(handle, 1.0);
    p[engine::distal_radius] = chain.arm[0][0] / excursion_slope(joint.mechanism, 1.0);
    p[engine::handle_length] = handle_length;
    p[engine::end_effector_length] = joint.length;
    p[engine::given_stiffness] = chain.stiffness[0];
    p[engine::pretension] = chain.pretension[0];
    if (bends) {
      p[engine::backbone_length] = joint.chord;
      p[engine::backbone_rigidity] = joint.stiffness * joint.chord;
    }
    return true;
  }

  template <class Work>
  void each_tendon(const In<2>& given, const Out<2>& out, const Work& work) const {
    require(given.shape(1) == tendons() && out.shape(0) == given.shape(0) && out.shape(1) == tendons(),
            "rows do not fit the tendons");
    std::visit(
        [&](const auto& chain) {
          for (std::size_t k = 0; k < given.shape(0) * tendons(); ++k)
            out.data()[k] = work(chain, int(k % tendons()), given.data()[k]);
        },
        any());
  }

  void check(const Rows& rows, const Statuses& status) const {
    const std::size_t count = status.shape(0);
    for (const In<2>* each : {&rows.held, &rows.stroke, &rows.wrench, &rows.grip})
      require(each->shape(0) == count || each->shape(0) == 1, "inputs differ in length");
    require(rows.wrench.shape(1) == 6 && rows.grip.shape(1) == 1 && rows.stroke.shape(1) == tendons(),
            "a wrench has six components, a grip force one, and strokes one for each tendon");
  }

  template <class Work>
  void each(const Rows& rows, const Statuses& status, int threads, const Work& work) const {
    check(rows, status);
    const nb::gil_scoped_release release;
    std::visit(
        [&]<class W>(const W& chain) {
          over_threads(status.shape(0), threads, 256, [&](std::size_t begin, std::size_t end) {
            for (std::size_t p = begin; p < end; ++p)
              status.data()[p] = static_cast<unsigned char>(work(Point<W>(chain, rows, p, handles(), tendons()), p));
          });
        },
        any());
  }
};

}  // namespace

void bind_tendon_chain(nb::module_& m) {
  m.attr("MOST_STRETCH_ENTRIES") = most_stretch_entries;
  m.attr("MOST_JOINTS") = most_joints;
  m.attr("MOST_TENDONS") = most_tendons;
  const nb::class_<ChainSpec> base(m, "ChainSpec");
  nb::class_<AnyTendonChain, ChainSpec>(m, "TendonChain")
      .def(nb::init<const std::vector<int>&, const std::vector<int>&, const In<2>&, const In<2>&, const In<2>&,
                    const std::vector<int>&, const std::vector<int>&, const In<2>&, const In<3>&>(),
           "mechanism"_a, "parent"_a, "numbers"_a, "arm"_a, "tendon"_a, "motor"_a, "handle"_a, "handle_arm"_a,
           "growth"_a)
      .def("solve", &AnyTendonChain::solve, "handle"_a, "stroke"_a, "wrench"_a, "grip"_a, "in_stem_axes"_a, "angle"_a,
           "tension"_a, "status"_a, "threads"_a)
      .def("answer", &AnyTendonChain::answer, "handle"_a, "stroke"_a, "wrench"_a, "grip"_a, "in_stem_axes"_a, "out"_a,
           "status"_a, "threads"_a)
      .def("handle_angles", &AnyTendonChain::handle_angles, "angle"_a, "stroke"_a, "wrench"_a, "grip"_a,
           "in_stem_axes"_a, "out"_a, "status"_a, "threads"_a)
      .def("compensation_strokes", &AnyTendonChain::compensation_strokes, "handle"_a, "stroke"_a, "wrench"_a, "grip"_a,
           "in_stem_axes"_a, "out"_a, "status"_a, "threads"_a)
      .def("stretches", &AnyTendonChain::stretches, "tension"_a, "out"_a)
      .def("tensions", &AnyTendonChain::tensions, "stretch"_a, "out"_a)
      .def("load_matrix", &AnyTendonChain::load_matrix, "angle"_a, "out"_a)
      .def("closed_form", &AnyTendonChain::closed_form, "handle_length"_a, "handle_range"_a,
           nb::sig("def closed_form(self, handle_length: float, handle_range: float) -> Spec | None"));
}

}  // namespace tenodesis::bindings

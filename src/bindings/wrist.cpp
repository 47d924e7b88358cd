// Wrists of joints that share tendons: statics over arrays.

#include <algorithm>
#include <cstring>

#include "evaluate.hpp"
#include "tenodesis/wrist_block.hpp"
#include "wrist_spec.hpp"

namespace tenodesis::bindings {

template <int... n>
void WristSpec::make(std::integer_sequence<int, n...>) {
  const bool paired = tendons_ <= 2 * joints_;
  const auto pick = [&]<int N>() {
    if (joints_ != std::size_t(N)) return;
    if (paired) {
      any_.template emplace<Paired<N>>();
    } else if constexpr (2 * N < int(most_wrist_tendons)) {
      any_.template emplace<Many<N>>();
    }
  };
  (pick.template operator()<n + 1>(), ...);
}

WristSpec::WristSpec(const std::vector<int>& mechanism, const std::vector<int>& parent, const In<2>& numbers,
                     const In<2>& arm, const In<2>& tendon, const std::vector<int>& motor,
                     const std::vector<int>& handle, const In<2>& handle_arm)
    : joints_(mechanism.size()), tendons_(arm.shape(0)), handles_(handle.size()) {
  require(joints_ >= 1 && joints_ <= most_wrist_joints && tendons_ <= most_wrist_tendons && handles_ <= joints_ &&
              parent.size() == joints_ && numbers.shape(0) == joints_ && numbers.shape(1) == joint_numbers &&
              arm.shape(1) == joints_ && tendon.shape(0) == tendons_ && tendon.shape(1) == 2 &&
              motor.size() == tendons_ && handle_arm.shape(0) == tendons_ && handle_arm.shape(1) == handles_,
          "joints, tendons and handle do not fit each other");
  make(std::make_integer_sequence<int, int(most_wrist_joints)>{});
  std::visit(
      [&](auto& wrist) {
        for (std::size_t i = 0; i < joints_; ++i) {
          const double* row = numbers.data() + i * joint_numbers;
          require(std::cmp_less(parent[i], i), "a joint stands on one that comes after it");
          wrist.joint[i] = {Mechanism(mechanism[i]),
                            parent[i],
                            {row[axis_x], row[axis_y], row[axis_z]},
                            row[offset],
                            row[chord],
                            row[length],
                            row[stiffness],
                            row[share],
                            row[grip]};
        }
        for (std::size_t m = 0; m < tendons_; ++m) {
          wrist.stiffness[m] = tendon.data()[2 * m];
          wrist.pretension[m] = tendon.data()[2 * m + 1];
          wrist.motor[m] = motor[m] != 0;
          for (std::size_t i = 0; i < joints_; ++i) wrist.arm[m][i] = arm.data()[m * joints_ + i];
          for (std::size_t h = 0; h < handles_; ++h) wrist.handle_arm[m][h] = handle_arm.data()[m * handles_ + h];
        }
        wrist.handles = int(handles_);
        for (std::size_t h = 0; h < handles_; ++h) wrist.handle[h] = Mechanism(handle[h]);
      },
      any_);
}

namespace {

/// Statics of a wrist over arrays.
class AnyWrist : public WristSpec {
 public:
  using WristSpec::WristSpec;

  /// Angles, tensions and status of every point.
  void solve(const In<2>& handle, const In<2>& stroke, const In<2>& load, bool in_stem_axes, const Out<2>& angle,
             const Out<2>& tension, const Statuses& status, int threads) const {
    check(handle, stroke, load, status);
    const nb::gil_scoped_release release;
    std::visit(
        [&](const auto& wrist) {
          using W = std::decay_t<decltype(wrist)>;
          const Rows rows{handle, stroke, load, in_stem_axes};
          const auto store = [&](std::size_t p, const Solved<W>& found, Status status_of) {
            const bool ok = status_of == Status::ok;
            for (std::size_t i = 0; i < joints(); ++i) angle.data()[p * joints() + i] = ok ? found.angle[i] : nan;
            for (std::size_t m = 0; m < tendons(); ++m) tension.data()[p * tendons() + m] = ok ? found.tension[m] : nan;
            status.data()[p] = static_cast<unsigned char>(status_of);
          };
          over_threads(status.shape(0), threads, 256, [&](std::size_t begin, std::size_t end) {
            Solved<W> found[lanes];
            for (std::size_t base = begin; base < end; base += lanes) {
              const std::size_t n = std::min(lanes, end - base);
              const std::uint32_t decided = solve_block(wrist, rows, base, n, found);
              for (std::size_t k = 0; k < n; ++k) {
                const bool is_decided = (decided >> k & 1u) != 0;
                store(base + k, found[k], is_decided ? Status::ok : solve_alone(wrist, rows, base + k, found[k]));
              }
            }
          });
        },
        any());
  }

  /// Rates of the angles: rows of joints by stiffness, wrench, grip, stroke, handle.
  void answer(const In<2>& handle, const In<2>& stroke, const In<2>& load, bool in_stem_axes, const Out<3>& out,
              const Statuses& status, int threads) const {
    const std::size_t width = joints() + load_components + tendons() + handles();
    require(out.shape(1) == joints() && out.shape(2) == width, "rates do not fit the wrist");
    each(handle, stroke, load, status, threads, [&](const auto& wrist, std::size_t p) {
      using W = std::decay_t<decltype(wrist)>;
      const Point<W> at(wrist, row(handle, p), row(stroke, p), row(load, p), handles(), tendons(), in_stem_axes);
      const auto found = tenodesis::solve(wrist, at.wound, at.load);
      WristAnswer<W> rates{};
      Status status_of = found.status;
      if (status_of == Status::ok) status_of = tenodesis::answer(wrist, at.wound, at.load, at.handle, found.x, rates);
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

  void handle_angles(const In<2>& angle, const In<2>& stroke, const In<2>& load, bool in_stem_axes, const Out<2>& out,
                     const Statuses& status, int threads) const {
    each(angle, stroke, load, status, threads, [&](const auto& wrist, std::size_t p) {
      using W = std::decay_t<decltype(wrist)>;
      const Point<W> at(wrist, nullptr, row(stroke, p), row(load, p), 0, tendons(), in_stem_axes);
      double handle[W::joints]{};
      const Status found = tenodesis::handle_angles(wrist, row(angle, p), at.load, at.stroke, handle);
      for (std::size_t h = 0; h < W::joints; ++h)
        if (h < handles()) out.data()[p * handles() + h] = found == Status::ok ? handle[h] : nan;
      return found;
    });
  }

  void compensation_strokes(const In<2>& handle, const In<2>& stroke, const In<2>& load, bool in_stem_axes,
                            const Out<2>& out, const Statuses& status, int threads) const {
    each(handle, stroke, load, status, threads, [&](const auto& wrist, std::size_t p) {
      using W = std::decay_t<decltype(wrist)>;
      const Point<W> at(wrist, row(handle, p), row(stroke, p), row(load, p), handles(), tendons(), in_stem_axes);
      double strokes[W::tendons]{};
      const Status found = tenodesis::compensation_strokes(wrist, at.wound, at.load, strokes);
      for (std::size_t m = 0; m < tendons(); ++m)
        out.data()[p * tendons() + m] = found == Status::ok ? strokes[m] : nan;
      return found;
    });
  }

 private:
  /// Inputs of a point, in the wrist's own sizes.
  template <class W>
  struct Point {
    double handle[W::joints]{};
    double stroke[W::tendons]{};
    double wound[W::tendons]{};
    WristLoad<double> load{};

    Point() = default;
    Point(const W& wrist, const double* handle_row, const double* stroke_row, const double* load_row,
          std::size_t handles, std::size_t tendons, bool in_stem_axes) {
      std::copy_n(handle_row, handles, handle);
      std::copy_n(stroke_row, tendons, stroke);
      wrist.wind(handle, stroke, wound);
      const double* w = load_row;
      load = {{{w[0], w[1], w[2]}, {w[3], w[4], w[5]}}, w[6], in_stem_axes};
    }
  };

  static const double* row(const In<2>& rows, std::size_t p) {
    return rows.data() + (rows.shape(0) == 1 ? 0 : p) * rows.shape(1);
  }

  static constexpr std::size_t lanes = 8;

  /// Angles (rad) and tensions (N) of a point.
  template <class W>
  struct Solved {
    double angle[W::joints]{};
    double tension[W::tendons]{};
  };

  /// Inputs of all points.
  struct Rows {
    const In<2>& handle;
    const In<2>& stroke;
    const In<2>& load;
    bool in_stem_axes;
  };

  template <class W>
  Status solve_alone(const W& wrist, const Rows& rows, std::size_t p, Solved<W>& out) const {
    const Point<W> at(wrist, row(rows.handle, p), row(rows.stroke, p), row(rows.load, p), handles(), tendons(),
                      rows.in_stem_axes);
    const auto found = tenodesis::solve(wrist, at.wound, at.load);
    if (found.status != Status::ok) return found.status;
    double drawn[W::tendons];
    wrist.excursions(found.x, drawn);
    for (int i = 0; i < W::joints; ++i) out.angle[i] = angle_at(wrist.joint[i].mechanism, found.x[i]);
    for (int m = 0; m < W::tendons; ++m) out.tension[m] = std::max(wrist.stretched(m, at.wound[m], drawn[m]), 0.0);
    return Status::ok;
  }

  // Solves n points from a place on. Bit k: whether the k-th is decided. Without wide vectors none is.
  template <class W>
  std::uint32_t solve_block([[maybe_unused]] const W& wrist, [[maybe_unused]] const Rows& rows,
                            [[maybe_unused]] std::size_t base, [[maybe_unused]] std::size_t n,
                            [[maybe_unused]] Solved<W>* out) const {
    std::uint32_t decided = 0;
#if defined(__GNUC__)
    // Other sizes would cost more time to compile than they save.
    if constexpr (W::joints == 2 && W::tendons == 4) {
      using L = Lanes<double, int(lanes)>;
      engine::in_wide_vectors([&] {
        L handle[W::joints], stroke[W::tendons], load[load_components], wound[W::tendons], drawn[W::tendons];
        // One number after another into a register would take longer than all that follows.
        const auto gather = [&](L* to, const In<2>& from, std::size_t count) {
          for (std::size_t c = 0; c < count; ++c) {
            double lane[lanes];
            // Lanes that are left over repeat the first point.
            for (std::size_t k = 0; k < lanes; ++k) lane[k] = row(from, base + (k < n ? k : 0))[c];
            std::memcpy(&to[c].v, lane, sizeof lane);
          }
        };
        gather(handle, rows.handle, std::min<std::size_t>(handles(), W::joints));
        gather(stroke, rows.stroke, std::min<std::size_t>(tendons(), W::tendons));
        gather(load, rows.load, load_components);
        wrist.wind(handle, stroke, wound);
        const WristLoad<L> all{{{load[0], load[1], load[2]}, {load[3], load[4], load[5]}}, load[6], rows.in_stem_axes};
        const auto found = solve_lanes(wrist, wound, all);
        wrist.excursions(found.x, drawn);
        for (int m = 0; m < W::tendons; ++m) drawn[m] = larger(wrist.stretched(m, wound[m], drawn[m]), L(0.0));
        for (std::size_t k = 0; k < n; ++k) {
          decided |= std::uint32_t(found.decided[int(k)] > 0) << k;
          for (int i = 0; i < W::joints; ++i) out[k].angle[i] = found.angle[i][int(k)];
          for (int m = 0; m < W::tendons; ++m) out[k].tension[m] = drawn[m][int(k)];
        }
      });
    }
#endif
    return decided;
  }

  void check(const In<2>& first, const In<2>& second, const In<2>& load, const Statuses& status) const {
    const std::size_t count = status.shape(0);
    for (const In<2>* rows : {&first, &second, &load})
      require(rows->shape(0) == count || rows->shape(0) == 1, "inputs differ in length");
    require(load.shape(1) == load_components, "a load has seven components");
  }

  template <class Work>
  void each(const In<2>& first, const In<2>& second, const In<2>& load, const Statuses& status, int threads,
            const Work& work) const {
    check(first, second, load, status);
    const nb::gil_scoped_release release;
    std::visit(
        [&](const auto& wrist) {
          over_threads(status.shape(0), threads, 256, [&](std::size_t begin, std::size_t end) {
            for (std::size_t p = begin; p < end; ++p) status.data()[p] = static_cast<unsigned char>(work(wrist, p));
          });
        },
        any());
  }
};

}  // namespace

void bind_wrist(nb::module_& m) {
  nb::class_<WristSpec>(m, "WristSpec");
  nb::class_<AnyWrist, WristSpec>(m, "Wrist")
      .def(nb::init<const std::vector<int>&, const std::vector<int>&, const In<2>&, const In<2>&, const In<2>&,
                    const std::vector<int>&, const std::vector<int>&, const In<2>&>(),
           "mechanism"_a, "parent"_a, "numbers"_a, "arm"_a, "tendon"_a, "motor"_a, "handle"_a, "handle_arm"_a)
      .def("solve", &AnyWrist::solve, "handle"_a, "stroke"_a, "load"_a, "in_stem_axes"_a, "angle"_a, "tension"_a,
           "status"_a, "threads"_a)
      .def("answer", &AnyWrist::answer, "handle"_a, "stroke"_a, "load"_a, "in_stem_axes"_a, "out"_a, "status"_a,
           "threads"_a)
      .def("handle_angles", &AnyWrist::handle_angles, "angle"_a, "stroke"_a, "load"_a, "in_stem_axes"_a, "out"_a,
           "status"_a, "threads"_a)
      .def("compensation_strokes", &AnyWrist::compensation_strokes, "handle"_a, "stroke"_a, "load"_a, "in_stem_axes"_a,
           "out"_a, "status"_a, "threads"_a);
}

}  // namespace tenodesis::bindings

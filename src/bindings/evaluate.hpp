#pragma once
// An operation over arrays: values in blocks over threads, derivatives point by point.

#include <algorithm>
#include <limits>
#include <span>
#include <thread>
#include <vector>

#include "block.hpp"
#include "engine/spec.hpp"

namespace tenodesis::bindings {

using engine::make_axis, engine::parameter_count, engine::Spec;

/// One input: an array of the common length, or a single value for all points.
struct Column {
  const double* data{};
  bool single{};

  double operator[](std::size_t i) const { return data[single ? 0 : i]; }
};

struct Points {
  std::span<const Column> columns;
  std::size_t count{};
};

inline constexpr double nan = std::numeric_limits<double>::quiet_NaN();

// With fewer points per thread, starting the thread costs more than it saves.
inline constexpr std::size_t points_per_thread = 4096;

template <class Work>
void over_threads(std::size_t count, int threads, std::size_t least, const Work& work) {
  const std::size_t parts = std::clamp<std::size_t>(count / least, 1, std::size_t(std::max(threads, 1)));
  // Full blocks per part, so that results do not depend on the number of threads.
  const std::size_t stride = (count / parts + block_size) / block_size * block_size;
  std::vector<std::jthread> pool;
  for (std::size_t begin = stride; begin < count; begin += stride)
    pool.emplace_back([&work, begin, end = std::min(begin + stride, count)] { work(begin, end); });
  work(0, std::min(stride, count));
}

template <class Operation, class A>
void evaluate_held(const A& axis, const Points& points, std::span<double* const> out, unsigned char* status,
                   std::size_t begin, std::size_t end) {
  Block block;
  std::array<unsigned char, block_size> found{};
  for (std::size_t k = 0; k < held_inputs; ++k) block.in[k].fill(points.columns[k][begin]);
  for (std::size_t base = begin; base < end; base += block_size) {
    // The last block is filled up with valid points of the previous one.
    const std::size_t n = std::min<std::size_t>(block_size, end - base);
    for (std::size_t k = 0; k < held_inputs; ++k)
      if (!points.columns[k].single) std::copy_n(points.columns[k].data + base, n, block.in[k].begin());
    solve_block<Operation>(axis, block, found);
    for (std::size_t k = 0; k < std::size_t(Operation::outputs); ++k)
      std::copy_n(block.out[k].begin(), n, out[k] + base);
    std::copy_n(found.begin(), n, status + base);
  }
}

template <class Operation, class A>
void evaluate_direct(const A& axis, const Points& points, std::span<double* const> out, unsigned char* status,
                     std::size_t begin, std::size_t end) {
  for (std::size_t i = begin; i < end; ++i) {
    double in[Operation::inputs], result[Operation::outputs];
    for (std::size_t k = 0; k < std::size_t(Operation::inputs); ++k) in[k] = points.columns[k][i];
    const Status found = Operation::run(axis, in, result);
    for (std::size_t k = 0; k < std::size_t(Operation::outputs); ++k) out[k][i] = found == Status::ok ? result[k] : nan;
    status[i] = static_cast<unsigned char>(found);
  }
}

/// A held operation as a direct one, for any number type.
template <class Held>
struct Direct {
  static constexpr int inputs = held_inputs;
  static constexpr int outputs = Held::outputs;
  template <class A, class S>
  static Status run(const A& axis, const S* in, S* out) {
    const Equilibrium<S> at = equilibrium(axis, in[held_handle_angle], held_load(in), held_stroke(in));
    if (at.status == Status::ok)
      Held::at(axis, in[held_handle_angle], TendonPair<S>::at_handle(axis, in[held_handle_angle], held_stroke(in)),
               at.coordinate, out);
    return at.status;
  }
};

inline constexpr std::size_t directions = 4;  // derivatives carried by one pass

/// Derivatives of every output by the given variables, stored as out[output][variable * count + point].
///
/// Variables below parameter_count are parameters, the others inputs.
template <class Operation>
void differentiate(const Spec& spec, const Points& points, std::span<const std::size_t> variables,
                   std::span<double* const> out, unsigned char* status, std::size_t begin, std::size_t end) {
  using D = Dual<double, directions>;
  for (std::size_t first = 0; first < variables.size(); first += directions) {
    const auto wanted = variables.subspan(first, std::min(directions, variables.size() - first));
    std::array<D, parameter_count> parameters;
    for (std::size_t p = 0; p < parameter_count; ++p) parameters[p] = D(spec.parameters[p]);
    for (std::size_t d = 0; d < wanted.size(); ++d)
      if (wanted[d] < parameter_count) parameters[wanted[d]].slope[d] = 1;
    std::visit(
        [&](const auto& axis) {
          for (std::size_t i = begin; i < end; ++i) {
            D in[Operation::inputs], result[Operation::outputs];
            for (std::size_t k = 0; k < std::size_t(Operation::inputs); ++k) in[k] = D(points.columns[k][i]);
            for (std::size_t d = 0; d < wanted.size(); ++d)
              if (wanted[d] >= parameter_count) in[wanted[d] - parameter_count].slope[d] = 1;
            const Status found = Operation::run(axis, in, result);
            status[i] = static_cast<unsigned char>(found);
            for (std::size_t k = 0; k < std::size_t(Operation::outputs); ++k)
              for (std::size_t d = 0; d < wanted.size(); ++d)
                out[k][(first + d) * points.count + i] = found == Status::ok ? result[k].slope[d] : nan;
          }
        },
        make_axis(spec, parameters));
  }
}

}  // namespace tenodesis::bindings

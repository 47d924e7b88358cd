#pragma once
// Twins of one kind side by side: what is asked of the code for each kind of processor.
//
// That code is compiled apart, for its processor alone, and shares no inline function with the rest of the program: the
// linker would keep one copy of it for all processors. So it lives in a namespace of its own, and only plain types
// pass.

#include <cstddef>
#include <cstdint>

namespace tenodesis_lanes {

/// What the twins of a group have in common.
struct Kind {
  int joint_type;  ///< a JointType
  double handle_range;
  int steps_per_sample;
  bool quasi_static;
};

/// Steps of all twins of a group; what is given by run is for the first lanes.
struct Job {
  std::size_t runs, steps;
  const double* const* commands;  ///< of each run, a row for each step
  const std::size_t* signals;     ///< that are kept, of every n-th step, as a row of columns each
  std::size_t signal_count, every, columns;
  double* const* out;      ///< of each run
  std::int64_t* outcomes;  ///< of each run: steps taken and status
  /// Asked for the spool velocities that hold from a step on, given the reading before it; null without controllers.
  void (*tick)(void* loop, std::size_t run, std::size_t step, const double* reading, double* velocity);
  /// Told of each step that is kept; null without controllers.
  void (*keep)(void* loop, std::size_t run, std::size_t column);
  void* loop;
  int steps_per_tick;
};

/// A twin's expected readings, with derivatives by at most most_directions of its parameters.
struct Gradient {
  int joint_type;
  double handle_range;
  const double* parameters;  ///< of the twin, then of its axis
  const double* commands;    ///< a row for each step
  std::size_t steps;
  bool as_read;                  ///< the handle is where its encoder, taken off its offset, reads the command
  const std::size_t* variables;  ///< places among the parameters
  std::size_t variable_count;
  double* out;              ///< by reading, row and step
  std::size_t rows, first;  ///< of out for each reading; the place of the first derivative among them, less one
};
inline constexpr std::size_t most_directions = 7;

/// How many twins make a group, and what can be done with one.
struct Lanes {
  int count;
  void* (*make)(const Kind& kind);
  /// Puts a lane to rest, with parameters of a twin and then its axis. Until then it does not run, nor after a step
  /// that it could not take.
  void (*start)(void* group, int lane, const double* parameters, std::uint64_t seed);
  void (*advance)(void* group, const Job& job);
  void (*release)(void* group);
  /// Steps taken and status.
  void (*differentiate)(const Gradient& of, std::int64_t outcome[2]);
};

extern const Lanes narrow;
#if defined(__x86_64__)
extern const Lanes avx2, avx512;
#endif

}  // namespace tenodesis_lanes

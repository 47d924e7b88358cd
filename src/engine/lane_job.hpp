#pragma once
// Twins of one kind side by side: what is asked of the code for each kind of processor.
//
// That code is compiled apart, for its processor alone, and shares no inline function with the rest of the program: the
// linker would keep one copy of it for all processors. So it lives in a namespace of its own, and only plain types
// pass.

#include <cstddef>
#include <cstdint>

namespace tenodesis_lanes {

/// What the twins of a group have in common: the axes and the tip's mechanism of their planar layout
/// (chain_layout.hpp).
struct Kind {
  int axes;
  int mechanism;
  bool quasi_static;
  /// Steps a twin alone, given as the bytes of its type, with a command and its state; returns the status.
  std::int64_t (*step_alone)(const void* twin, const void* command, void* state);
};

/// What a controller compensates: a joint of the handle and a pair of tendons.
struct Axis {
  std::size_t handle, agonist, antagonist;
};
/// Readings of an axis that a controller is asked with: handle angle, tensions, spool angles.
inline constexpr std::size_t axis_readings = 5;

/// Where a column of commands goes: its place in a row of a chain's commands (chain_rows.hpp), and by how much.
struct Column {
  std::size_t place;
  double factor;
};

/// Steps of all twins of a group; what is given by run is for the first lanes.
struct Job {
  std::size_t runs, steps;
  const double* const* commands;  ///< of each run, a row for each step
  const Column* columns;          ///< of a row; what none of them gives is zero
  std::size_t column_count;
  const std::size_t* signals;  ///< that are kept of every n-th step
  std::size_t signal_count, every;
  double* const* out;      ///< of each run
  std::size_t samples;     ///< of each signal in out
  std::int64_t* outcomes;  ///< of each run: steps taken and status
  /// Asked for the spool velocities that hold from a step on, given the readings before it, by axis; null without
  /// controllers.
  void (*tick)(void* loop, std::size_t run, std::size_t step, const double* readings, double* velocities);
  /// Told of each step that is kept; null without controllers.
  void (*keep)(void* loop, std::size_t run, std::size_t sample);
  void* loop;
  const Axis* axes;
  std::size_t axis_count;
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
  /// Puts a twin, and the state it is in, into a lane, each as the bytes of its type. Until then it does not run, nor
  /// after a step that it could not take.
  void (*start)(void* group, int lane, const void* twin, const void* state);
  void (*advance)(void* group, const Job& job);
  void (*release)(void* group);
  /// Steps taken and status; null where vectors are no wider than the program's own.
  void (*differentiate)(const Gradient& of, std::int64_t outcome[2]);
};

extern const Lanes narrow;
#if defined(__x86_64__)
extern const Lanes avx2, avx512;
#endif

}  // namespace tenodesis_lanes

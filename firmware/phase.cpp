#include "phase.hpp"

// The session is known nowhere else.
#include "../src/c/tenodesis.cpp"

std::uint32_t phase_of(const tenodesis_controller& controller, int axis) {
  const Session* session = session_of(&controller);
  if (session == nullptr) return 0;
  return with(*session,
              [&](const auto& own) { return static_cast<std::uint32_t>(own.state.axis[axis].compensator.phase); });
}

#pragma once
// Memory that a caller of a C interface provides: whether it can be read, and what has been put there.

#include <cstdint>
#include <cstring>

namespace tenodesis {

/// Neither null nor misaligned.
template <class... T>
bool good(const T*... pointer) {
  return ((pointer != nullptr && reinterpret_cast<std::uintptr_t>(pointer) % alignof(T) == 0) && ...);
}

/// The word at the head of a controller's memory, by which its functions know what they have put there; reads nothing
/// else.
template <class Controller>
std::uint64_t mark_of(const Controller* controller) {
  std::uint64_t found{};
  std::memcpy(&found, controller, sizeof found);
  return found;
}

}  // namespace tenodesis

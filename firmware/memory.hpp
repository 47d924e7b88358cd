#pragma once
// Where the linker script has put things, and how deep the stack has grown.

#include <cstdint>

namespace memory {

extern "C" {
extern std::uint32_t stack_bottom[], stack_top[], data_source[], data_begin[], data_end[], bss_begin[], bss_end[];
// Sizes: the symbol's address is the number.
extern char flash_used[], static_ram_used[], stack_size[];
extern char controller_begin[], controller_end[];
}

inline std::uint32_t number(const char* symbol) { return reinterpret_cast<std::uint32_t>(symbol); }

inline constexpr std::uint32_t paint = 0xC0FFEE11;

/// Marks what the stack has not reached yet; to be called from as near to its top as can be.
inline void paint_stack() {
  std::uint32_t* reached;
  asm("mov %0, sp" : "=r"(reached));
  // Volatile, or the loop became a call, which would paint over its own return.
  for (volatile std::uint32_t* at = stack_bottom; at != reached; ++at) *at = paint;
}

/// The most bytes that the stack has held since it was painted.
inline std::uint32_t stack_used() {
  const std::uint32_t* at = stack_bottom;
  while (*at == paint) ++at;
  return number(reinterpret_cast<const char*>(stack_top)) - number(reinterpret_cast<const char*>(at));
}

}  // namespace memory

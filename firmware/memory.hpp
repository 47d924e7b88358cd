#pragma once
// Addresses and sizes from the linker script, and the depth of the stack.

#include <cstdint>

namespace memory {

extern "C" {
extern std::uint32_t stack_bottom[], stack_top[], data_source[], data_begin[], data_end[], bss_begin[], bss_end[];
// Sizes: the symbol's address is the value.
extern char flash_used[], static_ram_used[], stack_size[];
extern char controller_begin[], controller_end[];
}

inline std::uint32_t number(const char* symbol) { return reinterpret_cast<std::uint32_t>(symbol); }

inline constexpr std::uint32_t paint = 0xC0FFEE11;

/// Marks the unused part of the stack; to be called as near to its top as possible.
inline void paint_stack() {
  std::uint32_t* reached;
  asm("mov %0, sp" : "=r"(reached));
  // Volatile, since a call of memset would overwrite its own return address.
  for (volatile std::uint32_t* at = stack_bottom; at != reached; ++at) *at = paint;
}

/// Largest size of the stack since it was painted, bytes.
inline std::uint32_t stack_used() {
  const std::uint32_t* at = stack_bottom;
  while (*at == paint) ++at;
  return number(reinterpret_cast<const char*>(stack_top)) - number(reinterpret_cast<const char*>(at));
}

}  // namespace memory

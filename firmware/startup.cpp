// From reset to the program, and the handler of processor faults.

#include <cstdint>

#include "memory.hpp"
#include "semihosting.hpp"

/// The program; what it returns is the exit code.
std::uint32_t run();

namespace {

constexpr std::uint32_t coprocessor_access = 0xE000ED88;  // CPACR
constexpr std::uint32_t full_fpu_access = 0xF << 20;

void enable_fpu() {
  *reinterpret_cast<volatile std::uint32_t*>(coprocessor_access) |= full_fpu_access;
  asm volatile("dsb\n isb" : : : "memory");
}

}  // namespace

extern "C" {

[[noreturn]] void report_fault(std::uint32_t pc) {
  semihosting::print_line("fault at PC ", semihosting::Hex{pc});
  semihosting::exit(1);
}

// The processor has pushed the program counter as the seventh word. The report gets the entire stack, which may have
// been what was missing; naked, since a prologue would move the stack pointer away from that word.
[[gnu::naked]] void fault() { asm("ldr r0, [sp, #24]\n ldr r1, =stack_top\n mov sp, r1\n b report_fault"); }

[[noreturn]] void reset() {
  enable_fpu();
  memory::paint_stack();
  const std::uint32_t* from = memory::data_source;
  for (std::uint32_t* to = memory::data_begin; to != memory::data_end; ++to) *to = *from++;
  for (std::uint32_t* to = memory::bss_begin; to != memory::bss_end; ++to) *to = 0;
  semihosting::exit(run());
}

}  // extern "C"

/// Vectors of the processor's exceptions; no interrupt is enabled.
[[gnu::section(".vectors"), gnu::used]] static const struct {
  std::uint32_t* stack{memory::stack_top};
  void (*reset)(){::reset};
  void (*rest[14])(){fault, fault, fault, fault, fault, fault, fault, fault, fault, fault, fault, fault, fault, fault};
} vectors;

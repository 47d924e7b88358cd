#pragma once
// Counts the instructions of a piece of work.
//
// QEMU has no cycle counter. With `-icount shift=6` its clock advances by 2^6 ns per instruction executed, so that
// SysTick, driven by that clock, counts instructions reproducibly, whatever the load of the PC. The number of ticks per
// instruction depends on the board's clock and is measured. On a chip the same code gives processor cycles in the unit
// of a loop of nops.

#include <cstdint>

class InstructionCounter {
 public:
  InstructionCounter() {
    systick->reload = longest;
    systick->control = enabled | at_processor_clock;
    // The difference of two loops cancels the cost of measuring.
    ticks_ = ticks_of(nops<2 * loops>) - ticks_of(nops<loops>);
    overhead_ = instructions(ticks_of([] {}));
  }

  /// Instructions that the work executes; below half a million.
  template <class Work>
  std::uint32_t count(const Work& work) const {
    return instructions(ticks_of(work)) - overhead_;
  }

  /// Of 1000 instructions.
  std::uint32_t ticks_of_thousand() const { return ticks_ * 1000 / (loops * instructions_per_loop); }

 private:
  struct SysTick {
    std::uint32_t control, reload, value, calibration;
  };
  static inline auto* const systick = reinterpret_cast<volatile SysTick*>(0xE000E010);
  static constexpr std::uint32_t enabled = 1, at_processor_clock = 4, longest = 0xFFFFFF;

  static constexpr std::uint32_t loops = 1000, instructions_per_loop = 5;

  template <std::uint32_t times>
  static void nops() {
    std::uint32_t left = times;
    asm volatile("1: nop\n nop\n nop\n subs %0, #1\n bne 1b" : "+r"(left) : : "cc");
  }

  // A tick is not an integer number of instructions: rounded up.
  std::uint32_t instructions(std::uint32_t ticks) const {
    return (ticks * (loops * instructions_per_loop) + ticks_ - 1) / ticks_;
  }

  // Clearing the counter starts a tick, so that equal work gives equal counts.
  template <class Work>
  [[gnu::noinline]] static std::uint32_t ticks_of(const Work& work) {
    systick->value = 0;
    while (systick->value == 0) {
    }
    const std::uint32_t before = systick->value;
    asm volatile("" : : : "memory");  // no work may be moved past the two readings
    work();
    asm volatile("" : : : "memory");
    return before - systick->value;
  }

  std::uint32_t ticks_{};
  std::uint32_t overhead_{};
};

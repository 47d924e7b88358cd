#pragma once
// How many instructions a piece of work takes.
//
// QEMU has no cycle counter. With `-icount shift=6` its clock stands still but for the instructions it executes, each
// of which moves it on by 2^6 ns; so SysTick, driven by that clock, counts instructions, the same number in every run
// whatever the PC is busy with. How many ticks an instruction makes is the board's clock's doing and is measured. On a
// chip the same code gives processor cycles in the unit of a loop of nops.

#include <cstdint>

class InstructionCounter {
 public:
  InstructionCounter() {
    systick->reload = longest;
    systick->control = enabled | at_processor_clock;
    // The difference of two loops, which is free of what it takes to measure one.
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

  // A tick is not a whole number of instructions: the last one that has begun counts.
  std::uint32_t instructions(std::uint32_t ticks) const {
    return (ticks * (loops * instructions_per_loop) + ticks_ - 1) / ticks_;
  }

  // Clearing the counter starts a tick, so that equal work gives equal ticks.
  template <class Work>
  [[gnu::noinline]] static std::uint32_t ticks_of(const Work& work) {
    systick->value = 0;
    while (systick->value == 0) {
    }
    const std::uint32_t before = systick->value;
    asm volatile("" : : : "memory");  // the compiler is to move no work out of the two readings
    work();
    asm volatile("" : : : "memory");
    return before - systick->value;
  }

  std::uint32_t ticks_{};
  std::uint32_t overhead_{};
};

#pragma once
// Time since the start, by the processor's own timer.

#include <cstdint>

class Clock {
 public:
  static constexpr std::uint32_t rate = 25000000;  // Hz, of this board

  Clock() {
    systick->reload = turn - 1;
    systick->value = 0;
    systick->control = enabled | interrupts | at_processor_clock;
  }

  /// Ticks of the processor's clock. Must be called at least once per turn, 5 ms, at which its interrupt wakes the
  /// processor.
  std::uint64_t ticks() {
    std::uint32_t left = 0;
    // The value is of this turn only if no turn has ended since.
    do {
      while (turned()) turns_ += turn;
      left = systick->value;
    } while (turned() && (turns_ += turn));
    *pending = clear_systick;
    return turns_ + (turn - 1 - left);
  }

  static std::uint64_t nanoseconds(std::uint64_t ticks) { return ticks * (1000000000 / rate); }

 private:
  struct SysTick {
    std::uint32_t control, reload, value, calibration;
  };
  static inline auto* const systick = reinterpret_cast<volatile SysTick*>(0xE000E010);
  static inline auto* const pending = reinterpret_cast<volatile std::uint32_t*>(0xE000ED04);
  static constexpr std::uint32_t enabled = 1, interrupts = 2, at_processor_clock = 4, has_turned = 1U << 16U;
  static constexpr std::uint32_t clear_systick = 1U << 25U;
  static constexpr std::uint32_t turn = rate / 200;

  // Reading it clears it.
  static bool turned() { return (systick->control & has_turned) != 0; }

  std::uint64_t turns_{};
};

#pragma once
// UART0 of Arm's MPS2 board (CMSDK), polled: it holds one byte, and QEMU's line waits until that is read. On a chip a
// line at full speed needs DMA, or an interrupt that fills a ring.

#include <cstddef>
#include <cstdint>

class Uart {
 public:
  explicit Uart(std::uint32_t divider) {
    registers->divider = divider;
    registers->control = transmits | receives | receive_interrupts;
    interrupts->enable = bit_of_interrupt;
    asm volatile("cpsid i");  // interrupts wake the processor, but are not taken: there are no handlers
  }

  bool read(std::uint8_t& byte) const {
    if ((registers->state & received) == 0) return false;
    byte = static_cast<std::uint8_t>(registers->data);
    return true;
  }

  void write(const std::uint8_t* bytes, std::size_t count) const {
    for (std::size_t k = 0; k < count; ++k) {
      while ((registers->state & full) != 0) {
      }
      registers->data = bytes[k];
    }
  }

  /// Sleeps until a byte, or another enabled interrupt, comes; returns at once if a byte is waiting.
  void wait() const {
    registers->interrupt = receive_interrupt;
    interrupts->clear = bit_of_interrupt;
    if ((registers->state & received) == 0) asm volatile("wfi" : : : "memory");
  }

 private:
  struct Registers {
    std::uint32_t data, state, control, interrupt, divider;
  };
  struct Interrupts {
    std::uint32_t enable, reserved[95], clear;  // pending
  };
  static inline auto* const registers = reinterpret_cast<volatile Registers*>(0x40004000);
  static inline auto* const interrupts = reinterpret_cast<volatile Interrupts*>(0xE000E100);
  static constexpr std::uint32_t full = 1, received = 2;
  static constexpr std::uint32_t transmits = 1, receives = 2, receive_interrupts = 8, receive_interrupt = 2;
  static constexpr std::uint32_t bit_of_interrupt = 1;  // number 0
};

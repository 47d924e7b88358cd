#pragma once
// Files and console of the PC through the debugger (Arm semihosting, version 3); QEMU provides it.

#include <cstdint>

namespace semihosting {

namespace detail {

enum class Operation : std::uint32_t { open = 0x01, write_text = 0x04, read = 0x06, exit_with_code = 0x20 };

// The debugger stops at this breakpoint and takes the request from the two registers.
inline std::int32_t request(Operation operation, const void* argument) {
  register auto number asm("r0") = static_cast<std::int32_t>(operation);
  register const void* block asm("r1") = argument;
  asm volatile("bkpt 0xab" : "+r"(number) : "r"(block) : "memory");
  return number;
}

}  // namespace detail

inline void print(const char* text) { detail::request(detail::Operation::write_text, text); }

inline void print(std::uint32_t number, std::uint32_t base = 10) {
  char digits[11];  // 2^32 has ten
  char* first = digits + sizeof digits - 1;
  *first = '\0';
  do {
    *--first = "0123456789abcdef"[number % base];
    number /= base;
  } while (number != 0);
  print(first);
}

/// A number to be printed in hexadecimal.
struct Hex {
  std::uint32_t number;
};

inline void print(Hex hex) {
  print("0x");
  print(hex.number, 16);
}

/// Texts and numbers, one after the other, and an end of line.
template <class... Parts>
void print_line(Parts... parts) {
  (print(parts), ...);
  print("\n");
}

[[noreturn]] inline void exit(std::uint32_t code) {
  constexpr std::uint32_t application_exit = 0x20026;
  const std::uint32_t block[] = {application_exit, code};
  for (;;) detail::request(detail::Operation::exit_with_code, block);
}

/// A file of the PC, read from its start.
class File {
 public:
  template <std::size_t size>
  explicit File(const char (&name)[size]) {
    constexpr std::uint32_t read_binary = 1;
    const struct {
      const char* name;
      std::uint32_t mode, length;
    } block{name, read_binary, size - 1};
    handle_ = detail::request(detail::Operation::open, &block);
  }

  bool is_open() const { return handle_ != -1; }

  /// Fills the item with the file's next bytes; false where there are not enough.
  template <class Item>
  bool read(Item& item) {
    const struct {
      std::int32_t handle;
      void* to;
      std::uint32_t bytes;
    } block{handle_, &item, sizeof item};
    return detail::request(detail::Operation::read, &block) == 0;  // bytes missing
  }

 private:
  std::int32_t handle_;
};

}  // namespace semihosting

// Runs the controller (SUBJECT, of the namespace instrument) on a recorded bench run and checks each of
// its outputs, bit for bit, against the PC's. Fails when one differs, when a tick takes more than BUDGET instructions,
// or when the stack was full.

#include <new>

#include "counter.hpp"
#include "memory.hpp"
#include "recording.hpp"
#include "semihosting.hpp"

using memory::number;
using semihosting::Hex, semihosting::print_line;

namespace {

// Not on the stack, as in a program that never ends.
alignas(SUBJECT) unsigned char subject_memory[sizeof(SUBJECT)];

struct Tally {
  std::uint32_t ticks{};
  std::uint32_t mismatches{};
  std::uint32_t instructions{};  ///< of all ticks
  std::uint32_t worst{};         ///< instructions of one tick
  std::uint32_t worst_tick{};
};

void compare(const recording::Words& expected, const recording::Words& got, Tally& tally) {
  for (std::uint32_t n = 0; n < recording::Words::count; ++n) {
    if (expected.word[n] == got.word[n]) continue;
    if (tally.mismatches++ == 0) {
      print_line("first mismatch: tick ", tally.ticks, ", output word ", n, ": PC ", Hex{expected.word[n]}, ", here ",
                 Hex{got.word[n]});
    }
  }
}

Tally replay(semihosting::File& file, std::uint32_t ticks) {
  const InstructionCounter counter;
  print_line("clock: ", counter.ticks_of_thousand(), " SysTicks per 1000 instructions");
  Tally tally;
  auto& subject = *new (subject_memory) SUBJECT;
  if (!subject.ready()) return tally;
  recording::Tick tick;
  while (file.read(tick)) {
    alignas(instrument::Output) unsigned char place[sizeof(instrument::Output)];
    const instrument::Output* made{};
    const std::uint32_t taken = counter.count([&] { made = new (place) instrument::Output(subject.step(tick.input)); });
    const instrument::Output& output = *made;
    compare(recording::Words(tick.output), recording::Words(output), tally);
    tally.instructions += taken;
    if (taken > tally.worst) {
      tally.worst = taken;
      tally.worst_tick = tally.ticks;
    }
    ++tally.ticks;
  }
  if (tally.ticks != ticks) tally.ticks = 0;
  return tally;
}

}  // namespace

std::uint32_t run() {
  semihosting::File file(RECORDING);
  recording::Header header{};
  const bool ours = file.is_open() && file.read(header) && header.tick_size == sizeof(recording::Tick);
  const Tally tally = ours ? replay(file, header.ticks) : Tally{};
  if (tally.ticks == 0) {
    print_line(RECORDING " is missing, truncated, or of another controller, or the parameters are not accepted");
    return 1;
  }
  print_line("ticks: ", tally.ticks, ", outputs that differ from the PC's: ", tally.mismatches);
  print_line("instructions per tick: mean ", tally.instructions / tally.ticks, ", worst ", tally.worst, " (tick ",
             tally.worst_tick, "), at most ", BUDGET);
  print_line("controller: ", number(memory::controller_end) - number(memory::controller_begin), " bytes of flash, ",
             sizeof(SUBJECT), " of RAM");
  const std::uint32_t stack = memory::stack_used();
  print_line("firmware: ", number(memory::flash_used), " bytes of flash, ", number(memory::static_ram_used),
             " of static RAM, ", stack, " of stack at most");
  const bool fits = tally.worst <= BUDGET && stack < number(memory::stack_size);
  return tally.mismatches == 0 && fits ? 0 : 1;
}

// Writes what the PC's controller of all joints makes of recorded readings. Usage: host_joints READINGS FILE

#include <cmath>
#include <cstdio>
#include <cstdlib>

#include "recording.hpp"

namespace {

long size_of(std::FILE* file) {
  std::fseek(file, 0, SEEK_END);
  const long size = std::ftell(file);
  std::rewind(file);
  return size;
}

}  // namespace

int main(int count, char** arguments) {
  std::FILE* const from = count == 3 ? std::fopen(arguments[1], "rb") : nullptr;
  std::FILE* const to = from == nullptr ? nullptr : std::fopen(arguments[2], "wb");
  instrument::Joints controller;
  if (to == nullptr || !controller.ready()) return 2;
  const auto ticks = static_cast<std::uint32_t>(size_of(from) / long(sizeof(instrument::Input)));
  const recording::Header header{ticks, sizeof(recording::Tick)};
  bool done = std::fwrite(&header, sizeof header, 1, to) == 1;
  recording::Tick tick{};
  for (std::uint32_t n = 0; n < ticks && done; ++n) {
    done = std::fread(&tick.input, sizeof tick.input, 1, from) == 1;
    tick.output = controller.step(tick.input);
    done = done && std::fwrite(&tick, sizeof tick, 1, to) == 1;
  }
  std::printf("recorded: %u ticks; state %u at their end\n", ticks, unsigned(tick.output.state));
  return std::fclose(to) == 0 && done && tick.output.state == TENODESIS_ENABLED ? 0 : 1;
}

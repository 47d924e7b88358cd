// The controller behind a serial line: the PC uploads its parameters and sends measurements, or lets the board measure
// by itself. The protocol is in tenodesis/frame.hpp, the board's side of it in endpoint.hpp.

#include <new>

#include "bench.hpp"
#include "clock.hpp"
#include "endpoint.hpp"
#include "uart.hpp"

namespace {

using tenodesis::link::Bytes, tenodesis::link::Decoder, tenodesis::link::Endpoint;

constexpr std::uint32_t divider = 16;  // of the clock: 1.56 Mbit/s, the most that the UART does
constexpr int bytes_between_checks = 256;

alignas(Endpoint) unsigned char endpoint_memory[sizeof(Endpoint)];
alignas(Decoder) unsigned char decoder_memory[sizeof(Decoder)];

// Takes a tick once per period of the board's clock.
class Streaming {
 public:
  void run(Endpoint& endpoint, const Uart& uart, Clock& clock) {
    const std::uint64_t ticks = clock.ticks();
    const auto period = static_cast<std::uint32_t>(endpoint.period() * float(Clock::rate));
    if (!endpoint.streams() || ticks - last_ < period) return;
    last_ = ticks - last_ < 2U * period ? last_ + period : ticks;
    tenodesis_measurement measured[TENODESIS_AXES]{};
    for (int n = 0; n < TENODESIS_AXES; ++n) bench_[n].measure(measured[n]);
    const Bytes tick = endpoint.tick(measured, Clock::nanoseconds(ticks));
    for (int n = 0; n < TENODESIS_AXES; ++n)
      for (int i = 0; i < 2; ++i) bench_[n].drive(i, endpoint.velocity(n, i), endpoint.period());
    endpoint.took(static_cast<std::uint32_t>(clock.ticks() - ticks));
    uart.write(tick.data, tick.size);
  }

 private:
  Bench bench_[TENODESIS_AXES]{};
  std::uint64_t last_{};
};

}  // namespace

std::uint32_t run() {
  auto& endpoint = *new (endpoint_memory) Endpoint("mps2-an386", Clock::rate, true);
  auto& decoder = *new (decoder_memory) Decoder;
  const Uart uart(divider);
  Clock clock;
  Streaming streaming;
  int unchecked = 0;
  for (;;) {
    std::uint8_t byte = 0;
    const bool came = uart.read(byte);
    if (came && decoder.push(byte)) {
      const std::uint64_t before = clock.ticks();
      const Bytes answer = endpoint.take(decoder, Clock::nanoseconds(before));
      if (!endpoint.streams()) endpoint.took(static_cast<std::uint32_t>(clock.ticks() - before));
      uart.write(answer.data, answer.size);
    }
    // Endless noise must not prevent the board from stopping.
    if (came && ++unchecked < bytes_between_checks) continue;
    unchecked = 0;
    endpoint.watch(Clock::nanoseconds(clock.ticks()));
    streaming.run(endpoint, uart, clock);
    if (!came && !endpoint.streams()) uart.wait();
  }
}

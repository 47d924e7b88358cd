// Claims about frames: one comes through intact or not at all, whatever is done to its bytes.

#include "tenodesis/frame.hpp"

#include "claim.hpp"
#include "frames.hpp"

void the_check_is_the_published_one() {
  // Check value of CRC-32/ISO-HDLC in the catalogue of parametrised CRC algorithms.
  const auto* digits = reinterpret_cast<const std::uint8_t*>("123456789");
  CLAIM(crc(digits, 9) == 0xCBF43926U);
  CLAIM(crc(digits + 4, 5, crc(digits, 4)) == 0xCBF43926U);
}

void every_payload_comes_through() {
  Decoder decoder;
  bool all = true;
  bool bare = true;
  for (std::size_t size = 0; size <= most_payload; ++size) {
    for (const double zeros : {0.0, 0.01, 0.5, 1.0}) {
      const Frame frame{{protocol_version, Type::output, 0, static_cast<std::uint32_t>(size)}, noise(size, zeros)};
      const Stream bytes = encoded(frame);
      bare = bare && std::ranges::count(bytes, 0) == 2 && bytes.front() == 0 && bytes.back() == 0;
      const auto found = decoded(decoder, bytes);
      all = all && found.size() == 1 && found[0] == frame;
    }
  }
  CLAIM(all);
  CLAIM(bare);
  CLAIM(decoder.damaged() == 0);
}

void the_frame_after_garbage_comes_through() {
  Decoder decoder;
  const Frame frame = step_frame();
  int lost = 0;
  int invented = 0;
  for (int run = 0; run < 2000; ++run) {
    const auto found = decoded(decoder, noise(std::size_t(run), 0.02) + encoded(frame));
    if (found.empty() || !(found.back() == frame)) ++lost;
    if (found.size() > 1) ++invented;
  }
  CLAIM(lost == 0);
  CLAIM(invented == 0);
  CLAIM(decoder.damaged() > 2000);
}

void a_frame_cut_short_is_dropped_and_the_next_is_not() {
  const Frame first = step_frame(1);
  const Frame second = step_frame(2);
  const Stream bytes = encoded(first);
  bool all = true;
  for (std::size_t size = 2; size + 1 < bytes.size(); ++size) {
    Decoder decoder;
    const Stream start(bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(size));
    const auto found = decoded(decoder, start + encoded(second));
    all = all && found.size() == 1 && found[0] == second && decoder.damaged() == 1;
  }
  CLAIM(all);
}

// Flips bits of a frame between two others; of what comes out, how many are none of the three.
int strangers_with_flips(const std::vector<Frame>& sent, const Stream& bytes, std::size_t first, std::size_t other) {
  Stream flipped = bytes;
  flipped[first / 8] ^= static_cast<std::uint8_t>(1U << (first % 8));
  if (other != first) flipped[other / 8] ^= static_cast<std::uint8_t>(1U << (other % 8));
  Decoder decoder;
  int strangers = 0;
  for (const Frame& found : decoded(decoder, flipped))
    if (std::ranges::find(sent, found) == sent.end()) ++strangers;
  return strangers;
}

void no_frame_with_flipped_bits_is_taken() {
  const std::vector<Frame> sent{step_frame(1), step_frame(0x01000000), step_frame(3)};
  const Stream before = encoded(sent[0]);
  const Stream bytes = before + encoded(sent[1]) + encoded(sent[2]);
  const std::size_t begin = before.size() * 8;
  const std::size_t end = begin + encoded(sent[1]).size() * 8;
  int single = 0;
  int twice = 0;
  for (std::size_t first = begin; first < end; ++first) {
    single += strangers_with_flips(sent, bytes, first, first);
    for (std::size_t other = first + 1; other < end; ++other) twice += strangers_with_flips(sent, bytes, first, other);
  }
  CLAIM(single == 0);
  CLAIM(twice == 0);
}

void a_frame_too_long_is_dropped() {
  Decoder decoder;
  const Frame frame = step_frame();
  for (const std::size_t size : {encoded_size(most_payload) + 1, std::size_t(100000)}) {
    const auto found = decoded(decoder, Stream{0} + noise(size, 0) + encoded(frame));
    CLAIM(found.size() == 1 && found[0] == frame);
  }
  CLAIM(decoder.damaged() == 2);
}

void sequences_go_round() {
  CLAIM(after(1, 0) && !after(0, 1) && !after(5, 5));
  CLAIM(after(0, 0xFFFFFFFFU) && !after(0xFFFFFFFFU, 0));
}

int main() {
  the_check_is_the_published_one();
  every_payload_comes_through();
  the_frame_after_garbage_comes_through();
  a_frame_cut_short_is_dropped_and_the_next_is_not();
  no_frame_with_flipped_bits_is_taken();
  a_frame_too_long_is_dropped();
  sequences_go_round();
  return claims::report();
}

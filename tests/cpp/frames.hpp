#pragma once
// Frames for the tests of the link to a board: encoded, decoded, and damaged.

#include <algorithm>
#include <cstring>
#include <random>
#include <vector>

#include "tenodesis/frame.hpp"

using namespace tenodesis::link;

using Stream = std::vector<std::uint8_t>;

struct Frame {
  Header header{};
  Stream payload;

  bool operator==(const Frame& other) const {
    return std::memcmp(&header, &other.header, sizeof header) == 0 && payload == other.payload;
  }
};

inline Stream encoded(const Frame& frame) {
  Stream bytes(encoded_size(frame.payload.size()));
  bytes.resize(encode(frame.header, frame.payload.data(), frame.payload.size(), bytes.data()));
  return bytes;
}

inline Frame frame_in(const Decoder& decoder) {
  return {decoder.header(), {decoder.payload(), decoder.payload() + decoder.size()}};
}

inline std::vector<Frame> decoded(Decoder& decoder, const Stream& bytes) {
  std::vector<Frame> found;
  for (const std::uint8_t byte : bytes)
    if (decoder.push(byte)) found.push_back(frame_in(decoder));
  return found;
}

inline Stream operator+(Stream first, const Stream& other) {
  first.insert(first.end(), other.begin(), other.end());
  return first;
}

/// Bytes of which a share is 0.
inline Stream noise(std::size_t count, double zeros) {
  static std::mt19937 random{7};  // NOLINT(cert-msc32-c,cert-msc51-cpp,bugprone-random-generator-seed)
  Stream bytes(count);
  for (auto& byte : bytes) {
    const bool zero = std::uniform_real_distribution<>(0, 1)(random) < zeros;
    byte = zero ? 0 : static_cast<std::uint8_t>(std::uniform_int_distribution<>(1, 255)(random));
  }
  return bytes;
}

inline Frame step_frame(std::uint32_t sequence = 3) {
  Step step{};
  step.time = 500000;
  step.axis[0] = {0.3F, {25.5F, 24.25F}, {0, -0.125F}};
  Frame frame{{protocol_version, Type::step, 0xBEEF, sequence}, Stream(size_with<Step>(1))};
  std::memcpy(frame.payload.data(), &step, size_with<Step>(1));
  return frame;
}

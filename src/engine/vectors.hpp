#pragma once
// Work that is compiled for several vector widths and run in the widest that this processor has.

#include <type_traits>

#include "lane_job.hpp"

namespace tenodesis::engine {

enum class Vectors { plain, avx2, avx512 };

template <class Work>
[[gnu::flatten]] void run_plain(const Work& work) {
  work();
}

#if defined(__x86_64__) && defined(__GNUC__)

#ifdef __clang__
#define TENODESIS_AVX512 "avx512f,avx512dq,avx512vl,avx2,fma"
#else
// By default gcc uses half the width.
#define TENODESIS_AVX512 "avx512f,avx512dq,avx512vl,avx2,fma,prefer-vector-width=512"
#endif

template <class Work>
[[gnu::target("avx2,fma"), gnu::flatten]] void run_avx2(const Work& work) {
  work();
}
template <class Work>
[[gnu::target(TENODESIS_AVX512), gnu::flatten]] void run_avx512(const Work& work) {
  work();
}

inline Vectors widest_vectors() {
  if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl"))
    return Vectors::avx512;
  return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") ? Vectors::avx2 : Vectors::plain;
}

template <class Work>
void in_widest_vectors(const Work& work) {
  static const Vectors widest = widest_vectors();
  if (widest == Vectors::avx512) return run_avx512(work);
  if (widest == Vectors::avx2) return run_avx2(work);
  run_plain(work);
}

/// Runs work that needs wide vectors to be worth it, with how many numbers a register holds, as a constant; false, and
/// nothing is done, where this processor has none.
template <class Work>
bool in_wide_lanes(const Work& work) {
  static const Vectors widest = widest_vectors();
  if (widest == Vectors::avx512) return run_avx512([&] { work(std::integral_constant<int, 8>{}); }), true;
  if (widest == Vectors::avx2) return run_avx2([&] { work(std::integral_constant<int, 4>{}); }), true;
  return false;
}

#else

template <class Work>
void in_widest_vectors(const Work& work) {
  run_plain(work);
}

template <class Work>
bool in_wide_lanes(const Work&) {
  return false;
}

#endif

/// The lanes of this processor, at most so many; null where there are none.
inline const tenodesis_lanes::Lanes* lanes_of_processor(int most) {
#if defined(__GNUC__)
#if defined(__x86_64__)
  const Vectors widest = widest_vectors();
  if (widest == Vectors::avx512 && most >= tenodesis_lanes::avx512.count) return &tenodesis_lanes::avx512;
  if (widest != Vectors::plain && most >= tenodesis_lanes::avx2.count) return &tenodesis_lanes::avx2;
#endif
  if (most >= tenodesis_lanes::narrow.count) return &tenodesis_lanes::narrow;
#endif
  return nullptr;
}

}  // namespace tenodesis::engine

#pragma once
// A queue from one thread to another, of fixed size, on which neither waits.

#include <array>
#include <atomic>
#include <cstddef>

namespace tenodesis::runtime {

template <class T, std::size_t size>
class Queue {
  static_assert((size & (size - 1)) == 0, "a power of two");

 public:
  /// By the thread that gives; false where it is full.
  bool push(const T& one) {
    const std::size_t end = end_.load(std::memory_order_relaxed);
    if (end - begin_.load(std::memory_order_acquire) == size) return false;
    places_[end % size] = one;
    end_.store(end + 1, std::memory_order_release);
    return true;
  }

  /// By the thread that takes; false where it is empty.
  bool pop(T& one) {
    const std::size_t begin = begin_.load(std::memory_order_relaxed);
    if (begin == end_.load(std::memory_order_acquire)) return false;
    one = places_[begin % size];
    begin_.store(begin + 1, std::memory_order_release);
    return true;
  }

  /// How many wait; by any thread.
  std::size_t pending() const {
    const std::size_t begin = begin_.load(std::memory_order_acquire);
    return end_.load(std::memory_order_acquire) - begin;
  }

 private:
  std::array<T, size> places_{};
  std::atomic<std::size_t> begin_;
  std::atomic<std::size_t> end_;
};

}  // namespace tenodesis::runtime

#pragma once
// Queues of fixed size: from one thread to another without waiting, and of requests to a controller.

#include <algorithm>
#include <array>
#include <atomic>
#include <cstddef>

#include "tenodesis/supervisor.hpp"

namespace tenodesis::runtime {

template <class T, std::size_t size>
class Queue {
  static_assert((size & (size - 1)) == 0, "a power of two");

 public:
  /// By the writing thread; false where it is full.
  bool push(const T& item) {
    const std::size_t end = end_.load(std::memory_order_relaxed);
    if (end - begin_.load(std::memory_order_acquire) == size) return false;
    places_[end % size] = item;
    end_.store(end + 1, std::memory_order_release);
    return true;
  }

  /// By the reading thread; false where it is empty.
  bool pop(T& item) {
    const std::size_t begin = begin_.load(std::memory_order_relaxed);
    if (begin == end_.load(std::memory_order_acquire)) return false;
    item = places_[begin % size];
    begin_.store(begin + 1, std::memory_order_release);
    return true;
  }

  /// Number of items that wait; by any thread.
  std::size_t pending() const {
    const std::size_t begin = begin_.load(std::memory_order_acquire);
    return end_.load(std::memory_order_acquire) - begin;
  }

 private:
  std::array<T, size> places_{};
  std::atomic<std::size_t> begin_;
  std::atomic<std::size_t> end_;
};

/// Requests that wait to be made, one per tick. Where it is full, the newest replaces the last: of so many within a few
/// ticks the latest is meant.
class RequestQueue {
 public:
  void push(Request request) {
    if (count_ == waiting_.size()) --count_;
    waiting_[count_++] = request;
  }

  /// The first of them, none where nothing waits.
  Request pop() {
    if (count_ == 0) return Request::none;
    const Request first = waiting_[0];
    std::copy(waiting_.begin() + 1, waiting_.end(), waiting_.begin());
    --count_;
    return first;
  }

  void clear() { count_ = 0; }
  Request first() const { return count_ == 0 ? Request::none : waiting_[0]; }
  Request last() const { return count_ == 0 ? Request::none : waiting_[count_ - 1]; }

 private:
  std::array<Request, 8> waiting_{};
  std::size_t count_{};
};

}  // namespace tenodesis::runtime

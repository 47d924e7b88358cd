#pragma once
// Records of the last ticks before a fault, and of a few after it.

namespace tenodesis {

/// Keeps the latest of capacity records, one of every stride ticks, until after records past a fault.
template <class Record, int capacity, int stride = 1, int after = 0>
struct FlightRecorder {
  static_assert(stride >= 1 && after >= 0 && after < capacity);

  /// To be called once per tick; the first tick of a fault is kept whatever the stride.
  void note(const Record& record, bool fault) {
    if (Record* at = place(fault)) *at = record;
  }

  /// The same for a record that is only made if it is kept: where to write it, or null.
  Record* place(bool fault) {
    if (frozen()) return nullptr;
    const bool starts = fault && !failed_;
    if (starts) {
      failed_ = true;
      left_ = after;
      wait_ = 0;
    }
    Record* const at = wait_ == 0 ? next() : nullptr;
    if (at != nullptr && failed_ && !starts) --left_;
    wait_ = wait_ + 1 < stride ? wait_ + 1 : 0;
    return at;
  }

  /// Whether recording has ended.
  bool frozen() const { return failed_ && left_ == 0; }

  int size() const { return size_; }

  /// A record by its age: 0 is the oldest, size() - 1 the latest.
  const Record& operator[](int n) const {
    const int at = next_ - size_ + n;
    return record_[at < 0 ? at + capacity : at];
  }

  /// Place of the fault's first tick, -1 without one.
  int fault_place() const { return failed_ ? size_ - 1 - (after - left_) : -1; }

  /// Discards all records and starts again.
  void rearm() {
    next_ = size_ = wait_ = left_ = 0;
    failed_ = false;
  }

 private:
  Record* next() {
    Record* const at = record_ + next_;
    next_ = next_ + 1 < capacity ? next_ + 1 : 0;
    if (size_ < capacity) ++size_;
    return at;
  }

  Record record_[capacity]{};
  int next_{};
  int size_{};
  int wait_{};
  int left_{};
  bool failed_{};
};

}  // namespace tenodesis

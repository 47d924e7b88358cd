#pragma once
// Records of the last ticks before a fault, and of a few after it. Whatever its memory holds, it reads and writes
// within its records: memory may be damaged.

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
    if (at != nullptr && failed_ && !starts) left_ = left() - 1;
    wait_ = wait_ >= 0 && wait_ < stride - 1 ? wait_ + 1 : 0;
    return at;
  }

  /// Whether recording has ended.
  bool frozen() const { return failed_ && left() == 0; }

  int size() const { return size_ < 0 ? 0 : size_ < capacity ? size_ : capacity; }

  /// A record by its age: 0 is the oldest, size() - 1 the latest.
  const Record& operator[](int n) const {
    const int at = (place_of_next() - size() + n) % capacity;
    return record_[at < 0 ? at + capacity : at];
  }

  /// Place of the fault's first tick, -1 without one.
  int fault_place() const { return failed_ ? size() - 1 - (after - left()) : -1; }

  /// Discards all records and starts again.
  void rearm() {
    next_ = size_ = wait_ = left_ = 0;
    failed_ = false;
  }

 private:
  Record* next() {
    const int at = place_of_next();
    next_ = at + 1 < capacity ? at + 1 : 0;
    size_ = size() < capacity ? size() + 1 : capacity;
    return record_ + at;
  }
  int left() const { return left_ < 0 ? 0 : left_ < after ? left_ : after; }
  int place_of_next() const { return next_ >= 0 && next_ < capacity ? next_ : 0; }

  Record record_[capacity]{};
  int next_{};
  int size_{};
  int wait_{};
  int left_{};
  bool failed_{};
};

}  // namespace tenodesis

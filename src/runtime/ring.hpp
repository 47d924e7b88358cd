#pragma once
// A ring of records in shared memory: one writer that never waits, any number of readers in any process, who see each
// record undivided or learn that they were too slow for it.

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <bit>
#include <cerrno>
#include <cstdint>
#include <span>
#include <string>
#include <system_error>

namespace tenodesis::runtime {

/// A file in memory, shared with all processes that map it.
class SharedMemory {
 public:
  static SharedMemory create(const std::string& path, std::size_t size) {
    SharedMemory memory;
    memory.open(path, O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, size);
    return memory;
  }
  static SharedMemory existing(const std::string& path) {
    SharedMemory memory;
    memory.open(path, O_RDONLY | O_CLOEXEC, 0);
    return memory;
  }

  SharedMemory() = default;
  SharedMemory(SharedMemory&& other) noexcept : data_(other.data_), size_(other.size_) { other.data_ = nullptr; }
  SharedMemory(const SharedMemory&) = delete;
  SharedMemory& operator=(const SharedMemory&) = delete;
  SharedMemory& operator=(SharedMemory&&) = delete;
  ~SharedMemory() {
    if (data_ != nullptr) ::munmap(data_, size_);
  }

  std::uint64_t* words() const { return static_cast<std::uint64_t*>(data_); }
  std::size_t size() const { return size_; }

 private:
  // A size of 0 takes the file's own, to be read only.
  void open(const std::string& path, int flags, std::size_t size) {
    const int file = ::open(path.c_str(), flags, 0600);
    if (file < 0) fail(path);
    struct stat status{};
    const bool writes = size > 0;
    const bool sized = writes ? reserve(file, size) : ::fstat(file, &status) == 0;
    size_ = writes ? size : static_cast<std::size_t>(status.st_size);
    void* mapped = MAP_FAILED;
    if (sized && size_ > 0)
      mapped = ::mmap(nullptr, size_, writes ? PROT_READ | PROT_WRITE : PROT_READ, MAP_SHARED, file, 0);
    const int problem = errno;
    ::close(file);
    if (mapped == MAP_FAILED) {
      errno = problem;
      fail(path);
    }
    data_ = mapped;
  }

  // Memory that is not reserved would end the loop where it turns out to be missing.
  static bool reserve(int file, std::size_t size) {
    errno = ::posix_fallocate(file, 0, static_cast<off_t>(size));
    return errno == 0;
  }

  [[noreturn]] static void fail(const std::string& path) {
    throw std::system_error(errno, std::generic_category(), path);
  }

  void* data_{};
  std::size_t size_{};
};

/// Layout of the memory in words of 8 bytes. A slot is its stamp and then the record; the stamp is odd while the record
/// is written, and gives the record's number.
struct RingLayout {
  static constexpr std::uint64_t magic = 0x31474e4952444e54;  // "TNDRING1"
  enum Word : std::size_t { magic_word, columns_word, capacity_word, written_word, alive_word };
  static constexpr std::size_t header_words = 512;

  std::size_t columns{};
  std::size_t capacity{};

  std::size_t words() const { return header_words + capacity * (columns + 1); }
  std::size_t slot(std::uint64_t number) const { return header_words + (number & (capacity - 1)) * (columns + 1); }
};

inline std::atomic_ref<std::uint64_t> shared(std::uint64_t& word) { return std::atomic_ref<std::uint64_t>(word); }

class RingWriter {
 public:
  RingWriter(const std::string& path, std::size_t columns, std::size_t capacity)
      : layout_{columns, std::bit_ceil(capacity)},
        memory_(SharedMemory::create(path, layout_.words() * sizeof(std::uint64_t))) {
    std::uint64_t* words = memory_.words();
    words[RingLayout::columns_word] = layout_.columns;
    words[RingLayout::capacity_word] = layout_.capacity;
    shared(words[RingLayout::magic_word]).store(RingLayout::magic, std::memory_order_release);
  }

  void write(std::span<const double> record) {
    std::uint64_t* words = memory_.words();
    std::uint64_t* slot = words + layout_.slot(written_);
    const std::uint64_t stamp = 2 * written_ + 1;
    shared(slot[0]).store(stamp, std::memory_order_relaxed);
    std::atomic_thread_fence(std::memory_order_release);
    for (std::size_t k = 0; k < layout_.columns; ++k)
      shared(slot[1 + k]).store(std::bit_cast<std::uint64_t>(record[k]), std::memory_order_relaxed);
    shared(slot[0]).store(stamp + 1, std::memory_order_release);
    shared(words[RingLayout::written_word]).store(++written_, std::memory_order_release);
  }

  /// Shows readers that the writer is alive, though it may write nothing.
  void report_alive(std::uint64_t nanoseconds) {
    shared(memory_.words()[RingLayout::alive_word]).store(nanoseconds, std::memory_order_relaxed);
  }

  std::uint64_t written() const { return written_; }

 private:
  RingLayout layout_;
  SharedMemory memory_;
  std::uint64_t written_{};
};

class RingReader {
 public:
  explicit RingReader(const std::string& path) : memory_(SharedMemory::existing(path)) {
    std::uint64_t* words = memory_.words();
    if (memory_.size() < RingLayout::header_words * sizeof(std::uint64_t) ||
        shared(words[RingLayout::magic_word]).load(std::memory_order_acquire) != RingLayout::magic)
      throw std::invalid_argument(path + " is no ring of this version");
    layout_ = {words[RingLayout::columns_word], words[RingLayout::capacity_word]};
    if (!std::has_single_bit(layout_.capacity) || memory_.size() < layout_.words() * sizeof(std::uint64_t))
      throw std::invalid_argument(path + " is cut short");
  }

  std::size_t columns() const { return layout_.columns; }
  std::size_t capacity() const { return layout_.capacity; }
  std::uint64_t written() const { return word(RingLayout::written_word).load(std::memory_order_acquire); }
  std::uint64_t alive() const { return word(RingLayout::alive_word).load(std::memory_order_relaxed); }

  /// Copies record `number`; false where it is not yet written, or overwritten.
  bool copy(std::uint64_t number, double* to) const {
    std::uint64_t* slot = memory_.words() + layout_.slot(number);
    const std::uint64_t stamp = 2 * number + 2;
    if (shared(slot[0]).load(std::memory_order_acquire) != stamp) return false;
    for (std::size_t k = 0; k < layout_.columns; ++k)
      to[k] = std::bit_cast<double>(shared(slot[1 + k]).load(std::memory_order_relaxed));
    std::atomic_thread_fence(std::memory_order_acquire);
    return shared(slot[0]).load(std::memory_order_relaxed) == stamp;
  }

  /// Copies up to `most` records from the cursor on, moves it, and returns how many; counts in `lost` those
  /// overwritten.
  std::size_t read(std::uint64_t& cursor, std::size_t most, double* to, std::uint64_t& lost) const {
    std::size_t count = 0;
    while (count < most) {
      const std::uint64_t end = written();
      if (cursor >= end) break;
      // A quarter is left to the writer, which continues meanwhile.
      if (end - cursor > layout_.capacity) {
        const std::uint64_t oldest = end - layout_.capacity + layout_.capacity / 4;
        lost += oldest - cursor;
        cursor = oldest;
      }
      if (copy(cursor, to + count * layout_.columns))
        ++count;
      else
        ++lost;
      ++cursor;
    }
    return count;
  }

 private:
  std::atomic_ref<std::uint64_t> word(std::size_t at) const { return shared(memory_.words()[at]); }

  RingLayout layout_{};
  SharedMemory memory_;
};

}  // namespace tenodesis::runtime

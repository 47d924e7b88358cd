#pragma once
// The live loop: a thread of its own that reads the device, asks the controller, tells the motors, and writes every
// tick into a ring. It never waits for whoever watches or commands it.

#include <pthread.h>
#include <signal.h>
#include <time.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "../bindings/closed_loop.hpp"
#include "device.hpp"
#include "durations.hpp"
#include "queue.hpp"
#include "realtime.hpp"
#include "ring.hpp"

namespace tenodesis::runtime {

using bindings::AnyController;
using bindings::control_signal_count;

enum class OrderKind : unsigned char {
  request,  ///< a: a Request
  law,      ///< a: ControlLaw, b: Actuation
  hand,     ///< value: handle angle, axis
  force,    ///< value: N, axis
  radial,   ///< value: N, axis
  speed,    ///< value: simulated over real time; 0: as fast as it goes
  tamper,   ///< a: place, b: Tampering, axis, value; ticks: for how long
  drop,     ///< what is left of a played motion; the hand stays where it is
};

struct Order {
  OrderKind kind{};
  int a{}, b{}, axis{};
  double value{};
  std::uint64_t ticks{};
};

/// What a played motion does to all axes in one tick.
struct Row {
  Benches bench{};
};

/// Why the loop has stopped the motors by itself, or could not do what it was asked.
enum class Problem : unsigned char {
  none,
  tip_lost,        ///< the load was more than the tip can hold, and was not taken
  late,            ///< a tick came later than the bound
  no_measurement,  ///< the device said nothing for longer than the bound
  operator_gone,   ///< the lease ran out
};

struct Settings {
  double period{5e-4};          ///< of ticks, s
  double speed{1};              ///< simulated over real time
  double late_bound{0.05};      ///< s, past which motors that are real are stopped
  double hand_speed{3};         ///< of a hand that follows a slider, rad/s
  double hand_smoothing{0.04};  ///< s
  double handle_range[most_axes]{};
  bool real_time{true};  ///< whether to ask the operating system for it
};

/// Columns of a record: those of the tick, then those of each axis.
inline constexpr std::array tick_columns{"time",    "request", "homed", "homing",          "first_faults",
                                         "stopped", "problem", "late",  "controller_time", "fresh"};
inline constexpr std::array bench_columns{"commanded_handle_angle", "radial_force"};
inline constexpr std::size_t axis_columns = bench_columns.size() + signal_count + control_signal_count;

inline std::size_t columns(int axes) { return tick_columns.size() + std::size_t(axes) * axis_columns; }

inline std::uint64_t now() {
  timespec time{};
  ::clock_gettime(CLOCK_MONOTONIC, &time);
  return static_cast<std::uint64_t>(time.tv_sec) * 1'000'000'000 + static_cast<std::uint64_t>(time.tv_nsec);
}

class Runtime {
 public:
  static constexpr std::size_t rows_ahead = 4096;

  /// Device and controller outlive it, and are its own between start and finish.
  Runtime(Device& device, AnyController& controller, const Settings& settings, const std::string& ring,
          std::size_t ring_capacity)
      : device_(device),
        controller_(controller),
        settings_(settings),
        ring_(ring, columns(device.axes()), ring_capacity),
        record_(columns(device.axes())) {}

  ~Runtime() { finish(); }
  Runtime(const Runtime&) = delete;
  Runtime& operator=(const Runtime&) = delete;

  void start() {
    if (thread_.joinable()) return;
    ending_.store(false);
    thread_ = std::thread([this] { run(0); });
  }

  /// Takes so many ticks as fast as they go, on the caller's thread.
  void run_ticks(std::uint64_t count) {
    settings_.speed = 0;
    settings_.real_time = false;
    run(count);
  }

  void finish() {
    ending_.store(true);
    if (thread_.joinable()) thread_.join();
  }

  bool running() const { return running_.load(); }

  // For whoever commands: one thread at a time.
  bool order(const Order& order) { return orders_.push(order); }
  bool play(const Row& row) { return rows_.push(row); }
  std::size_t pending_rows() const { return rows_.pending(); }
  /// The operator is there for so many ns more; 0: there is none. Once there has been one, nothing sets motors free
  /// without.
  void lease(std::uint64_t nanoseconds) {
    if (nanoseconds == 0) {
      lease_.store(0);
      absent_.store(true);
      return;
    }
    operated_.store(true);
    lease_.store(now() + nanoseconds);
  }
  /// Motors to zero with the next tick, until a request sets them free; by any thread, and never refused.
  void stop() { stop_asked_.store(true); }

  // For whoever watches.
  const Durations& compute() const { return compute_; }
  const Durations& control() const { return control_; }
  const Durations& lateness() const { return lateness_; }
  std::uint64_t ticks() const { return ticks_.load(); }
  std::uint64_t late() const { return late_.load(); }
  std::uint64_t missed() const { return missed_.load(); }
  Problem problem() const { return problem_.load(); }
  double speed() const { return speed_.load(); }
  void forget_timing() { forget_.store(true); }
  std::vector<std::string> refused() const {
    const std::scoped_lock lock(refused_mutex_);
    return refused_;
  }

 private:
  struct Hand {
    double target{}, speed{};
  };
  struct Tampered {
    bindings::Tampering mode{};
    double value{};
    std::uint64_t until{};  ///< tick
  };
  static constexpr int priority = 50;
  static constexpr std::uint64_t longest_start = 1'000'000'000;  // of a device's first measurement, ns
  static constexpr std::size_t places = bindings::tamper_places.size();

  // ------------------------------------------------------------------ time

  void run(std::uint64_t most) {
    running_.store(true);
    sigset_t all;
    ::sigfillset(&all);
    if (most == 0) ::pthread_sigmask(SIG_BLOCK, &all, nullptr);
    speed_.store(settings_.speed);
    schedule();
    next_ = begun_ = now();
    for (std::uint64_t taken = 0; !ending_.load(std::memory_order_relaxed) && (most == 0 || taken < most); ++taken)
      take_turn();
    halt();
    running_.store(false);
  }

  // A loop that never sleeps leaves the processor to others.
  void schedule() {
    if (!settings_.real_time) return;
    if (!device_.clocked() && !(settings_.speed > 0)) return yield_real_time();
    const std::vector<std::string> refused = ask_for_real_time(priority);
    const std::scoped_lock lock(refused_mutex_);
    refused_ = refused;
  }

  void take_turn() {
    if (forget_.exchange(false)) forget();
    const std::uint64_t due = device_.clocked() ? 0 : wait();
    input_.request = Request::none;
    bool fresh = true;
    if (device_.clocked()) fresh = device_.read(input_, std::uint64_t(2e9 * settings_.period));
    const std::uint64_t begun = now();
    if (!device_.clocked()) fresh = device_.read(input_, 0);
    ring_.beat(begun);
    // Before a device has said anything there is nothing to answer.
    if (device_.clocked() && !fresh && last_fresh_ == 0) {
      if (begun - begun_ > longest_start) tell(Problem::no_measurement);
      return;
    }
    judge_time(fresh, due, begun);
    tick(begun, fresh);
    compute_.note(now() - begun);
    ticks_.fetch_add(1, std::memory_order_relaxed);
  }

  std::uint64_t wall_period() const { return std::uint64_t(settings_.period * 1e9 / settings_.speed); }

  /// Sleeps until the tick is due and says when that was; 0 without a clock.
  std::uint64_t wait() {
    if (!(settings_.speed > 0)) return 0;
    next_ += wall_period();
    const timespec until{time_t(next_ / 1'000'000'000), long(next_ % 1'000'000'000)};
    while (::clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, nullptr) == EINTR) {
    }
    return next_;
  }

  void judge_time(bool fresh, std::uint64_t due, std::uint64_t begun) {
    late_now_ = 0;
    if (device_.clocked()) {
      const std::uint64_t silent = last_fresh_ == 0 ? 0 : begun - last_fresh_;
      if (fresh) {
        const auto period = std::uint64_t(settings_.period * 1e9);
        if (last_fresh_ != 0) {
          late_now_ = silent > period ? silent - period : 0;
          lateness_.note(late_now_);
          count_late(late_now_, period);
          missed_.fetch_add(device_.overtaken(), std::memory_order_relaxed);
          if (double(late_now_) > settings_.late_bound * 1e9) stop_for(Problem::late);
        }
        last_fresh_ = begun;
      } else {
        missed_.fetch_add(1, std::memory_order_relaxed);
        if (double(silent) > settings_.late_bound * 1e9) stop_for(Problem::no_measurement);
      }
      return;
    }
    if (due == 0) return;
    late_now_ = begun > due ? begun - due : 0;
    lateness_.note(late_now_);
    count_late(late_now_, wall_period());
    if (double(late_now_) > settings_.late_bound * 1e9) {
      // What is too late is not caught up with: time goes on from here.
      missed_.fetch_add((begun - due) / wall_period(), std::memory_order_relaxed);
      next_ = begun;
      if (!device_.simulated()) stop_for(Problem::late);
    }
  }

  void count_late(std::uint64_t by, std::uint64_t period) {
    if (by > period / 2) late_.fetch_add(1, std::memory_order_relaxed);
  }

  void forget() {
    compute_.clear();
    control_.clear();
    lateness_.clear();
    late_.store(0);
    missed_.store(0);
    ticks_.store(0);
  }

  // ------------------------------------------------------------------ one tick

  void tick(std::uint64_t begun, bool fresh) {
    // What stops counts after the orders that came with it.
    const bool absent = absent_.exchange(false), stops = stop_asked_.exchange(false);
    take_orders();
    std::uint64_t until = lease_.load();
    const bool over = until != 0 && begun > until && lease_.compare_exchange_strong(until, 0);
    if (absent || over) {
      if (controller_.last.state != OperatingState::disabled) tell(Problem::operator_gone);
      ask(Request::pause);
    }
    if (stops) {
      stopped_ = true;
      drop_rows();
      ask(Request::pause);
    }
    move_hands();
    measured_at_ = input_.time;
    for (int n = 0; n < device_.axes(); ++n) tamper_with(n);
    const bool left_out = tampered(0, places - 1, input_.time);
    // Of a tick that the controller does not get, it gets the request with the next.
    input_.request = left_out ? Request::none : next_request();
    const std::uint64_t asked = now();
    if (!left_out) controller_.step(input_, controller_.last);
    const std::uint64_t answered = now();
    control_.note(answered - asked);
    Velocities speed{};
    if (!stopped_)
      for (int n = 0; n < device_.axes(); ++n)
        for (std::size_t i = 0; i < 2; ++i) speed[n][i] = pass(n, 5 + i, controller_.last.axis[n].spool_velocity[i]);
    if (!device_.write(speed, bench_)) {
      tell(Problem::tip_lost);
      for (std::size_t n = 0; n < most_axes; ++n) {
        bench_[n].force = bench_before_[n].force;
        bench_[n].radial_force = bench_before_[n].radial_force;
      }
    }
    bench_before_ = bench_;
    note(fresh, answered - asked, speed);
    ++tick_;
  }

  void take_orders() {
    Order order;
    while (orders_.pop(order)) {
      const auto n = static_cast<std::size_t>(std::clamp(order.axis, 0, device_.axes() - 1));
      switch (order.kind) {
        case OrderKind::request:
          obey(Request(order.a));
          break;
        case OrderKind::law:
          controller_.choose(ControlLaw(order.a), Actuation(order.b));
          break;
        case OrderKind::hand:
          hand_[n].target = std::clamp(order.value, -settings_.handle_range[n], settings_.handle_range[n]);
          break;
        case OrderKind::force:
          bench_[n].force = order.value;
          forgive(Problem::tip_lost);
          break;
        case OrderKind::radial:
          bench_[n].radial_force = order.value;
          forgive(Problem::tip_lost);
          break;
        case OrderKind::speed:
          settings_.speed = order.value;
          speed_.store(order.value);
          schedule();
          next_ = now();
          break;
        case OrderKind::tamper:
          tampered_[n][static_cast<std::size_t>(order.a)] = {bindings::Tampering(order.b), order.value,
                                                             tick_ + order.ticks};
          break;
        case OrderKind::drop:
          drop_rows();
          break;
      }
    }
  }

  // What sets motors free also forgets why they were stopped.
  void obey(Request request) {
    if (request == Request::enable || request == Request::resume || request == Request::home ||
        request == Request::clear) {
      if (operated_.load() && lease_.load() == 0) return;
      stopped_ = false;
      problem_.store(Problem::none);
    }
    ask(request);
  }

  // The hand stays where it is, so that whatever moves it next knows where from.
  void drop_rows() {
    Row row;
    while (rows_.pop(row)) {
    }
    for (std::size_t n = 0; n < most_axes; ++n) hand_[n] = {bench_[n].handle_angle, 0};
  }

  void ask(Request request) {
    // What stops is not kept waiting by what moves.
    const bool disables = asked_count_ > 0 && asked_[0] == Request::disable;
    if (request == Request::disable || (request == Request::pause && !disables)) asked_count_ = 0;
    if (asked_count_ > 0 && asked_[asked_count_ - 1] == request) return;
    // The newest takes the last place: of so many within eight ticks the latest is what is meant.
    if (asked_count_ == asked_.size()) --asked_count_;
    asked_[asked_count_++] = request;
  }

  Request next_request() {
    if (asked_count_ == 0) return Request::none;
    const Request first = asked_[0];
    std::copy(asked_.begin() + 1, asked_.end(), asked_.begin());
    --asked_count_;
    return first;
  }

  void stop_for(Problem why) {
    if (!stopped_) {
      stopped_ = true;
      ask(Request::pause);
    }
    tell(why);
  }

  void forgive(Problem past) { problem_.compare_exchange_strong(past, Problem::none); }

  // The first cause is kept until motors are set free.
  void tell(Problem why) {
    Problem none = Problem::none;
    problem_.compare_exchange_strong(none, why);
  }

  void move_hands() {
    Row row;
    if (rows_.pop(row)) {
      for (std::size_t n = 0; n < most_axes; ++n) {
        bench_[n] = row.bench[n];
        hand_[n] = {row.bench[n].handle_angle, 0};
      }
      return;
    }
    // A critically damped follower, no faster than a hand.
    const double rate = 1 / settings_.hand_smoothing;
    for (std::size_t n = 0; n < most_axes; ++n) {
      Hand& hand = hand_[n];
      double& at = bench_[n].handle_angle;
      hand.speed += settings_.period * rate * (rate * (hand.target - at) - 2 * hand.speed);
      hand.speed = std::clamp(hand.speed, -settings_.hand_speed, settings_.hand_speed);
      at += settings_.period * hand.speed;
      at = std::clamp(at, -settings_.handle_range[n], settings_.handle_range[n]);
    }
  }

  // ------------------------------------------------------------------ faults put in on purpose

  bool tampered(std::size_t axis, std::size_t place, std::uint64_t& time) {
    const Tampered& one = tampered_[axis][place];
    if (one.mode == bindings::Tampering::none || tick_ >= one.until) return false;
    if (one.mode == bindings::Tampering::add)
      time = static_cast<std::uint64_t>(std::max(0.0, double(time) + one.value * 1e9));
    if (one.mode == bindings::Tampering::set) time = static_cast<std::uint64_t>(std::max(0.0, one.value * 1e9));
    return one.mode == bindings::Tampering::hold;
  }

  double pass(int axis, std::size_t place, double value) {
    const auto n = static_cast<std::size_t>(axis);
    const Tampered& one = tampered_[n][place];
    double& kept = passed_[n][place];
    if (tick_ >= one.until) return kept = value;
    if (one.mode == bindings::Tampering::add) return kept = value + one.value;
    if (one.mode == bindings::Tampering::set) return kept = one.value;
    return one.mode == bindings::Tampering::hold ? kept : kept = value;
  }

  void tamper_with(int axis) {
    auto& measured = input_.axis[axis];
    measured.handle_angle = pass(axis, 0, measured.handle_angle);
    for (std::size_t i = 0; i < 2; ++i) {
      measured.tension[i] = pass(axis, 1 + i, measured.tension[i]);
      measured.spool_angle[i] = pass(axis, 3 + i, measured.spool_angle[i]);
    }
  }

  // ------------------------------------------------------------------ the record

  void note(bool fresh, std::uint64_t controller_time, const Velocities& speed) {
    const bindings::AnyOutput& output = controller_.last;
    double* to = record_.data();
    for (const double value :
         {double(measured_at_) * 1e-9, double(input_.request), double(output.homed), double(output.homing),
          double(output.first_faults), double(stopped_), double(problem_.load(std::memory_order_relaxed)),
          double(late_now_) * 1e-9, double(controller_time) * 1e-9, double(fresh)})
      *to++ = value;
    for (int n = 0; n < device_.axes(); ++n) {
      const Bench& bench = bench_[std::size_t(n)];
      const bool simulated = device_.simulated();
      *to++ = simulated ? bench.handle_angle : std::numeric_limits<double>::quiet_NaN();
      *to++ = simulated ? bench.radial_force : std::numeric_limits<double>::quiet_NaN();
      const Signals known = device_.signals(n);
      to = std::ranges::copy(known, to).out;
      auto said = bindings::control_signals(controller_, std::size_t(n));
      // What the motors were told, which is not what the controller asked while they are stopped.
      said[6] = speed[n][0];
      said[7] = speed[n][1];
      to = std::ranges::copy(said, to).out;
    }
    ring_.write(record_);
  }

  // Motors at rest whichever way the loop ends.
  void halt() {
    const Velocities rest{};
    if (!device_.simulated()) device_.write(rest, bench_);
    device_.stop();
  }

  Device& device_;
  AnyController& controller_;
  Settings settings_;
  RingWriter ring_;
  std::vector<double> record_;

  std::thread thread_;
  std::atomic<bool> ending_, running_, forget_, absent_, operated_, stop_asked_;
  Queue<Order, 1024> orders_;
  Queue<Row, rows_ahead> rows_;
  std::atomic<std::uint64_t> lease_;

  AnyInput input_{};
  Benches bench_{}, bench_before_{};
  std::array<Hand, most_axes> hand_{};
  std::array<std::array<Tampered, places>, most_axes> tampered_{};
  double passed_[most_axes][places]{};
  std::array<Request, 8> asked_{};
  std::size_t asked_count_{};
  bool stopped_{};
  std::uint64_t tick_{};
  std::uint64_t begun_{}, next_{}, last_fresh_{}, late_now_{}, measured_at_{};

  Durations compute_, control_, lateness_;
  std::atomic<std::uint64_t> ticks_, late_, missed_;
  std::atomic<Problem> problem_;
  std::atomic<double> speed_;
  mutable std::mutex refused_mutex_;
  std::vector<std::string> refused_;
};

}  // namespace tenodesis::runtime

#pragma once
// The live loop: a thread of its own that reads the device, steps the controller, commands the motors, and writes every
// tick into a ring. It never waits for those who watch or command it.

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

#include "durations.hpp"
#include "orders.hpp"
#include "queue.hpp"
#include "realtime.hpp"
#include "ring.hpp"

namespace tenodesis::runtime {

using engine::AnyController;

class Runtime {
 public:
  static constexpr std::size_t played_ahead = 4096;

  /// Device and controller must outlive it, and belong to it between start and finish.
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

  /// Takes so many ticks as fast as possible, on the caller's thread.
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

  // For the commanding thread, of which there may be one at a time.

  /// False where too many orders wait already.
  bool order(const Order& order) { return orders_.push(order); }
  bool play(const PlayedTick& tick) { return played_.push(tick); }
  std::size_t pending_ticks() const { return played_.pending(); }
  /// The operator is present for so many ns more; 0: is absent. After the first lease, motors are released only while
  /// the operator is present.
  void lease(std::uint64_t nanoseconds) {
    if (nanoseconds == 0) {
      lease_.store(0);
      absent_.store(true);
      return;
    }
    operated_.store(true);
    lease_.store(now() + nanoseconds);
  }
  /// Motors to zero with the next tick, until a request releases them; by any thread, and never refused.
  void stop() { stop_ordered_.store(true); }

  // For watching threads.

  const Durations& compute() const { return compute_; }
  const Durations& control() const { return control_; }
  const Durations& lateness() const { return lateness_; }
  std::uint64_t ticks() const { return ticks_.load(); }
  std::uint64_t late() const { return late_.load(); }
  std::uint64_t missed() const { return missed_.load(); }
  Problem problem() const { return problem_.load(); }
  double speed() const { return speed_.load(); }
  void forget_timing() { forget_.store(true); }
  /// A sentence for each thing that the operating system has refused.
  std::vector<std::string> refused() const {
    const std::scoped_lock lock(refused_mutex_);
    return refused_;
  }

 private:
  struct Hand {
    double target{}, speed{};
  };
  struct TimedInjection {
    engine::Injection fault{};
    std::uint64_t until{};  ///< tick
  };
  static constexpr int priority = 50;
  static constexpr std::uint64_t longest_start = 1'000'000'000;  // until a device's first measurement, ns

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
    ring_.report_alive(begun);
    // Before a device's first measurement there is nothing to control.
    if (device_.clocked() && !fresh && last_fresh_ == 0) {
      if (begun - begun_ > longest_start) report(Problem::no_measurement);
      return;
    }
    check_time(fresh, due, begun);
    tick(begun, fresh);
    compute_.note(now() - begun);
    ticks_.fetch_add(1, std::memory_order_relaxed);
  }

  std::uint64_t wall_period() const { return std::uint64_t(settings_.period * 1e9 / settings_.speed); }

  /// Sleeps until the tick is due and returns that time; 0 without a clock.
  std::uint64_t wait() {
    if (!(settings_.speed > 0)) return 0;
    next_ += wall_period();
    const timespec until{time_t(next_ / 1'000'000'000), long(next_ % 1'000'000'000)};
    while (::clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, nullptr) == EINTR) {
    }
    return next_;
  }

  void check_time(bool fresh, std::uint64_t due, std::uint64_t begun) {
    late_now_ = 0;
    if (device_.clocked()) return check_device_time(fresh, begun);
    if (due == 0) return;
    note_lateness(begun > due ? begun - due : 0, wall_period());
    if (!too_long(late_now_)) return;
    // Ticks missed by so much are not made up for: the schedule continues from here.
    missed_.fetch_add((begun - due) / wall_period(), std::memory_order_relaxed);
    next_ = begun;
    if (!device_.simulated()) stop_for(Problem::late);
  }

  void check_device_time(bool fresh, std::uint64_t begun) {
    const std::uint64_t silent = last_fresh_ == 0 ? 0 : begun - last_fresh_;
    if (!fresh) {
      missed_.fetch_add(1, std::memory_order_relaxed);
      if (too_long(silent)) stop_for(Problem::no_measurement);
      return;
    }
    if (last_fresh_ != 0) {
      const auto period = std::uint64_t(settings_.period * 1e9);
      note_lateness(silent > period ? silent - period : 0, period);
      missed_.fetch_add(device_.overtaken(), std::memory_order_relaxed);
      if (too_long(late_now_)) stop_for(Problem::late);
    }
    last_fresh_ = begun;
  }

  bool too_long(std::uint64_t delay) const { return double(delay) > settings_.late_bound * 1e9; }

  void note_lateness(std::uint64_t by, std::uint64_t period) {
    late_now_ = by;
    lateness_.note(by);
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
    // A stop is applied after the orders that came with it.
    const bool absent = absent_.exchange(false), stops = stop_ordered_.exchange(false);
    take_orders();
    std::uint64_t until = lease_.load();
    const bool over = until != 0 && begun > until && lease_.compare_exchange_strong(until, 0);
    if (absent || over) {
      if (controller_.last.state != OperatingState::disabled) report(Problem::operator_gone);
      request(Request::pause);
    }
    if (stops) {
      stopped_ = true;
      drop_played();
      request(Request::pause);
    }
    move_hands();
    measured_at_ = input_.time;
    for (std::size_t n = 0; n < axes(); ++n)
      input_.axis[n] =
          controller_.injector.pass(n, input_.axis[n], [&](std::size_t point) { return injected(n, point); });
    const bool given = inject_into_tick() && !awaits_measurement(begun, fresh);
    // The request of a tick that does not reach the controller is made with the next.
    input_.request = given ? requests_.pop() : Request::none;
    const std::uint64_t asked = now();
    if (given) controller_.step(input_, controller_.last);
    const std::uint64_t answered = now();
    control_.note(answered - asked);
    Velocities speed{};
    const double silent = controller_.injector.silent();
    if (!stopped_ && (silent <= 0 || !controller_.watchdog(silent))) send_velocities(speed);
    if (controller_.last.cut_power) device_.cut_power();
    if (!device_.write(speed, bench_)) {
      report(Problem::tip_lost);
      for (std::size_t n = 0; n < most_axes; ++n) {
        bench_[n].force = bench_before_[n].force;
        bench_[n].radial_force = bench_before_[n].radial_force;
      }
    }
    bool in_tissue = false;
    for (std::size_t n = 0; n < axes(); ++n) {
      if (!device_.in_tissue(static_cast<int>(n))) continue;
      bench_[n].contact = {};
      in_tissue = true;
    }
    if (in_tissue)
      report(Problem::in_tissue);
    else
      withdraw(Problem::in_tissue);
    bench_before_ = bench_;
    record(fresh, answered - asked, speed);
    ++tick_;
  }

  std::size_t axes() const { return static_cast<std::size_t>(device_.axes()); }

  engine::Injection injected(std::size_t axis, std::size_t point) const {
    const TimedInjection& injection = injection_[axis][point];
    return tick_ < injection.until ? injection.fault : engine::Injection{};
  }

  /// False where the tick is left out.
  bool inject_into_tick() {
    const engine::Injection fault = injected(0, engine::at_tick);
    auto time = double(input_.time);
    const bool given = controller_.injector.pass_tick(fault, time);
    if (fault.mode != engine::InjectionMode::none) input_.time = static_cast<std::uint64_t>(time);
    return given;
  }

  /// Whether a measurement is late by less than the controller's watchdog, so that the controller waits for it. The old
  /// one again would mean that time stands still, which is a fault at once.
  bool awaits_measurement(std::uint64_t begun, bool fresh) const {
    if (fresh || !device_.may_be_late()) return false;
    const std::uint64_t silent = begun - last_fresh_;
    return !too_long(silent) && !controller_.watchdog(double(silent) * 1e-9);
  }

  void send_velocities(Velocities& speed) {
    for (std::size_t n = 0; n < axes(); ++n) {
      const auto sent = controller_.injector.pass_pair(n, engine::at_velocity, controller_.last.axis[n].spool_velocity,
                                                       [&](std::size_t point) { return injected(n, point); });
      for (std::size_t i = 0; i < 2; ++i) speed[n][i] = sent[i];
    }
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
          withdraw(Problem::tip_lost);
          break;
        case OrderKind::radial:
          bench_[n].radial_force = order.value;
          withdraw(Problem::tip_lost);
          break;
        case OrderKind::speed:
          settings_.speed = order.value;
          speed_.store(order.value);
          schedule();
          next_ = now();
          break;
        case OrderKind::inject_fault:
          injection_[n][static_cast<std::size_t>(order.a)] = {{engine::InjectionMode(order.b), order.value},
                                                              tick_ + order.ticks};
          break;
        case OrderKind::drop:
          drop_played();
          for (auto& bench : bench_) bench.contact = {};
          break;
      }
    }
  }

  // A request that releases the motors also clears the reason why they were stopped.
  void obey(Request wanted) {
    if (wanted == Request::enable || wanted == Request::resume || wanted == Request::home || wanted == Request::clear) {
      if (operated_.load() && lease_.load() == 0) return;
      stopped_ = false;
      problem_.store(Problem::none);
    }
    request(wanted);
  }

  // The hand stays where it is, from where the next motion starts.
  void drop_played() {
    PlayedTick played;
    while (played_.pop(played)) {
    }
    for (std::size_t n = 0; n < most_axes; ++n) hand_[n] = {bench_[n].handle_angle, 0};
  }

  void request(Request wanted) {
    // A request that stops does not wait for those that move.
    const bool disables = requests_.first() == Request::disable;
    if (wanted == Request::disable || (wanted == Request::pause && !disables)) requests_.clear();
    if (requests_.last() != wanted) requests_.push(wanted);
  }

  void stop_for(Problem why) {
    if (!stopped_) {
      stopped_ = true;
      request(Request::pause);
    }
    report(why);
  }

  void withdraw(Problem past) { problem_.compare_exchange_strong(past, Problem::none); }

  // The first problem is kept until the motors are released.
  void report(Problem why) {
    Problem none = Problem::none;
    problem_.compare_exchange_strong(none, why);
  }

  void move_hands() {
    PlayedTick played;
    if (played_.pop(played)) {
      for (std::size_t n = 0; n < most_axes; ++n) {
        bench_[n] = played.bench[n];
        hand_[n] = {played.bench[n].handle_angle, 0};
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

  // ------------------------------------------------------------------ the record

  void record(bool fresh, std::uint64_t controller_time, const Velocities& speed) {
    const engine::AnyOutput& output = controller_.last;
    double* to = record_.data();
    for (const double value :
         {double(measured_at_) * 1e-9, double(input_.request), double(output.homed), double(output.homing),
          double(output.first_faults), double(stopped_), double(problem_.load(std::memory_order_relaxed)),
          double(late_now_) * 1e-9, double(controller_time) * 1e-9, double(fresh)})
      *to++ = value;
    for (std::size_t n = 0; n < axes(); ++n) {
      const bool simulated = device_.simulated();
      *to++ = simulated ? bench_[n].handle_angle : unknown;
      const Contact<double>& contact = bench_[n].contact;
      for (const double value : {bench_[n].radial_force, contact.angle, contact.stiffness, contact.damping})
        *to++ = simulated ? value : unknown;
      to = std::ranges::copy(device_.signals(static_cast<int>(n)), to).out;
      engine::ControlSignals signals = engine::control_signals(controller_, n);
      // What the motors were sent, which is not what the controller wanted while they are stopped.
      for (std::size_t i = 0; i < 2; ++i) signals[engine::velocity_signal + i] = speed[n][i];
      to = std::ranges::copy(signals, to).out;
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
  std::atomic<bool> ending_, running_, forget_, absent_, operated_, stop_ordered_;
  Queue<Order, 1024> orders_;
  Queue<PlayedTick, played_ahead> played_;
  std::atomic<std::uint64_t> lease_;

  AnyInput input_{};
  Benches bench_{}, bench_before_{};
  std::array<Hand, most_axes> hand_{};
  TimedInjection injection_[most_axes][engine::injection_point_count]{};
  RequestQueue requests_;
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

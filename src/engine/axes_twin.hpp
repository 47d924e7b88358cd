#pragma once
// Axes that do not act on each other: a twin for each, side by side, as one.

#include <utility>

#include "axis_rows.hpp"
#include "chain_twin.hpp"
#include "twin_spec.hpp"

namespace tenodesis::engine {

/// The twin of an axis, as a chain of one joint.
inline std::unique_ptr<AnyTwin> make_twin(const TwinSpec& spec, std::uint64_t seed) {
  return with_twin(spec, [&]<class T>(const T& twin) -> std::unique_ptr<AnyTwin> {
    return std::make_unique<ChainTwin<T>>(twin, ChainSizes{1, 1, 2}, seed);
  });
}

/// Twins of one joint each; in the place of a wrench every axis has a force, a radial one and a weight of its own.
class AxesTwin final : public AnyTwin {
 public:
  explicit AxesTwin(std::vector<std::unique_ptr<AnyTwin>> parts)
      : parts_(std::move(parts)), sizes_{parts_.size(), parts_.size(), 2 * parts_.size()} {
    row_.resize(width_of(parts_[0]->commands()));
  }
  AxesTwin(const AxesTwin& other) : sizes_(other.sizes_), row_(other.row_) {
    for (const auto& part : other.parts_) parts_.push_back(part->copy());
  }
  AxesTwin& operator=(const AxesTwin&) = delete;
  ~AxesTwin() override = default;

  std::unique_ptr<AnyTwin> copy() const override { return std::make_unique<AxesTwin>(*this); }
  const ChainSizes& sizes() const override { return sizes_; }

  std::vector<Column> commands() const override {
    std::vector<Column> all;
    all.reserve(axis_columns.size());
    for (const AxisColumn& column : axis_columns) all.emplace_back(column.name, column.width * parts_.size());
    return all;
  }

  std::vector<Column> signals() const override {
    std::vector<Column> all = parts_[0]->signals();
    for (Column& column : all) column.second *= parts_.size();
    all.emplace_back("force", parts_.size());
    return all;
  }

  Status step(const double* command) override {
    for (std::size_t n = 0; n < parts_.size(); ++n) {
      const Status found = parts_[n]->step(row_of(n, command));
      if (found != Status::ok) return found;
    }
    return Status::ok;
  }

  Status audit(const double* command, double* energy) override {
    double stored = 0;
    for (std::size_t n = 0; n < parts_.size(); ++n) {
      const Status found = parts_[n]->audit(row_of(n, command), energy);
      if (found != Status::ok) return found;
      stored += energy[1];
    }
    energy[1] = stored;
    return Status::ok;
  }

  bool step_or_hold(const double* command) override {
    bool taken = true;
    for (std::size_t n = 0; n < parts_.size(); ++n) taken = parts_[n]->step_or_hold(row_of(n, command)) && taken;
    return taken;
  }

  double stored() const override {
    double sum = 0;
    for (const auto& part : parts_) sum += part->stored();
    return sum;
  }

  double* store(double* out) const override {
    double* const end = parts_.size() == 1 ? parts_[0]->store(out) : store_by_name(out);
    return std::ranges::transform(parts_, end, [](const auto& part) { return -part->force(); }).out;
  }

  Measurement<double> reading(const CompensatedAxis& of) const override {
    return parts_[of.handle]->reading({0, of.agonist % 2, of.antagonist % 2});
  }
  double force() const override { return parts_[0]->force(); }
  double handle_wanted(std::size_t h) const override { return parts_[h]->handle_wanted(0); }
  Contact<double> contact(std::size_t joint) const override { return parts_[joint]->contact(0); }
  bool inside(std::size_t joint, const Contact<double>& contact) const override {
    return parts_[joint]->inside(0, contact);
  }

  std::string state() const override {
    std::string all;
    for (const auto& part : parts_) all += part->state();
    return all;
  }
  void set_state(std::string_view bytes) override {
    const std::size_t each = bytes.size() / parts_.size();
    for (std::size_t n = 0; n < parts_.size(); ++n) parts_[n]->set_state(bytes.substr(n * each, each));
  }

  std::optional<LaneTwinBytes> in_lanes() const override {
    return parts_.size() == 1 ? parts_[0]->in_lanes() : std::nullopt;
  }
  std::vector<tenodesis_lanes::Column> lane_columns() const override {
    std::vector<tenodesis_lanes::Column> all;
    for (const AxisColumn& column : axis_columns)
      for (std::size_t k = 0; k < column.width; ++k) all.push_back({column.place + k, column.factor});
    return all;
  }

 private:
  // The parts' signals, those of one name together.
  double* store_by_name(double* out) const {
    const auto each = parts_[0]->signals();
    std::vector<double> own(width_of(each));
    for (std::size_t n = 0; n < parts_.size(); ++n) {
      parts_[n]->store(own.data());
      const double* from = own.data();
      double* to = out;
      for (const auto& [name, width] : each) {
        std::copy_n(from, width, to + n * width);
        from += width;
        to += parts_.size() * width;
      }
    }
    return out + parts_.size() * own.size();
  }

  // The row of a part; of a single one all places are constants.
  const double* row_of(std::size_t n, const double* command) {
    return parts_.size() == 1 ? filled(std::integral_constant<std::size_t, 1>{}, 0, command)
                              : filled(parts_.size(), n, command);
  }
  template <class Count>
  const double* filled(const Count count, std::size_t n, const double* command) {
    std::size_t before = 0;
    each<int(axis_columns.size())>([&](auto c) {
      constexpr AxisColumn column = axis_columns[std::size_t(c)];
      const double* from = command + count * before + n * column.width;
      for (std::size_t k = 0; k < column.width; ++k) row_[column.place + k] = from[k] * column.factor;
      before += column.width;
    });
    return row_.data();
  }

  std::vector<std::unique_ptr<AnyTwin>> parts_;
  ChainSizes sizes_;
  std::vector<double> row_;
};

}  // namespace tenodesis::engine

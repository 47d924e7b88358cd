// Twins of chains of all sizes: what takes longest to compile, and knows no Python.

#include "engine/any_chain.hpp"
#include "engine/chain_twin.hpp"

namespace tenodesis::engine {

std::unique_ptr<AnyTwin> twin_of(const AnyChain& chain, const TwinRows& rows, const ChainSizes& sizes) {
  return std::visit([&](const auto& of) { return make_twin<int(most_tendons)>(of, rows, sizes); }, chain);
}

}  // namespace tenodesis::engine

#pragma once
// A chain of any size, and its twin.

#include <memory>
#include <variant>

#include "any_twin.hpp"
#include "tenodesis/tendon_chain.hpp"

namespace tenodesis::engine {

template <int N>
using Paired = TendonChain<double, N, 2 * N>;
template <int N>
using Many = TendonChain<double, N, int(most_tendons)>;
// A chain whose size is not built has the next larger one, whose further joints are inert. Most chains have two tendons
// a joint or fewer; their loops are short.
#ifdef TENODESIS_FEW_SIZES
// Where speed does not matter, two sizes do for all: only numbers differ.
using AnyChain = std::variant<Paired<2>, Many<int(most_joints)>>;
#else
using AnyChain = std::variant<Paired<1>, Paired<2>, Many<2>, Paired<3>, Paired<4>, Many<4>, Many<6>, Many<8>, Many<12>,
                              Many<int(most_joints)>>;
#endif

struct TwinRows;

/// The twin of a chain.
std::unique_ptr<AnyTwin> twin_of(const AnyChain& chain, const TwinRows& rows, const ChainSizes& sizes);

}  // namespace tenodesis::engine

// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/photometric/photometric_equations.h"

#include "base/parallel.h"

#include <algorithm>
#include <utility>

namespace dsorb::init_orb {

namespace {

std::vector<std::size_t> equalBlocks(std::size_t patches) {
  std::vector<std::size_t> begin;
  for (std::size_t i = 0; i < patches; i += kPatchBlock) begin.push_back(i);
  begin.push_back(patches);
  return begin;
}

}  // namespace

PhotometricLinearizer::PhotometricLinearizer(const PhotometricProblem& problem)
    : PhotometricLinearizer(problem, equalBlocks(problem.patches.size())) {}

PhotometricLinearizer::PhotometricLinearizer(const PhotometricProblem& problem,
                                             std::vector<std::size_t> block_begin)
    : problem_(problem),
      block_begin_(std::move(block_begin)),
      inverse_depth_(problem.patches.size()),
      sums_(blocks() * problem.frames.size()) {}

Eigen::VectorXd PhotometricLinearizer::blockGradient(std::size_t block) const {
  const int size = frameSize(problem_.brightness);
  Eigen::VectorXd gradient(static_cast<Eigen::Index>(problem_.frames.size()) * size);
  for (std::size_t f = 0; f < problem_.frames.size(); ++f) {
    const float* sum = sums_[block * problem_.frames.size() + f].data();
    for (int i = 0; i < size; ++i) {
      sum += size - i;
      gradient[static_cast<Eigen::Index>(f) * size + i] = static_cast<double>(*sum++);
    }
  }
  return gradient;
}

void PhotometricLinearizer::linearize(const PhotometricState& state,
                                      PhotometricEquations& equations) {
  prepare(state, equations);
  forEachRange(blocks(), 1, [&](std::size_t begin, std::size_t end) {
    for (std::size_t block = begin; block < end; ++block) linearizeBlock(block, equations);
  });
  collect(equations);
}

void PhotometricLinearizer::prepare(const PhotometricState& state,
                                    PhotometricEquations& equations) {
  const std::size_t frames = problem_.frames.size();
  images_.clear();
  for (std::size_t f = 0; f < frames; ++f) images_.push_back(patchImage(problem_, state, f));
  std::transform(state.inverse_depth.begin(),
                 state.inverse_depth.end(),
                 inverse_depth_.begin(),
                 [](double value) { return static_cast<float>(value); });
  equations.frame_size = frameSize(problem_.brightness);
  const auto size = static_cast<Eigen::Index>(frames) * equations.frame_size;
  equations.system.reset(size, problem_.patches.size());
  equations.energy.assign(problem_.patches.size(), 0);
}

void PhotometricLinearizer::linearizeBlock(std::size_t block, PhotometricEquations& equations) {
  const std::size_t first = block_begin_[block];
  const std::size_t count = block_begin_[block + 1] - first;
  for (std::size_t f = 0; f < problem_.frames.size(); ++f) {
    const PatchRun run{problem_.patches.data() + first,
                       inverse_depth_.data() + first,
                       problem_.seenIn(f) + first,
                       count};
    const PatchTotals sums{
        equations.system.sumsOf(first, f * static_cast<std::size_t>(equations.frame_size)),
        equations.energy.data() + first};
    auto& frame_sums = sums_[block * problem_.frames.size() + f];
    frame_sums.fill(0);
    linearizePatches(images_[f], run, sums, frame_sums);
  }
}

void PhotometricLinearizer::collect(PhotometricEquations& equations) const {
  const int size = equations.frame_size;
  Eigen::MatrixXd& H = equations.system.H;
  const std::size_t frames = problem_.frames.size();
  for (std::size_t f = 0; f < frames; ++f) {
    const auto at = static_cast<Eigen::Index>(f) * size;
    for (std::size_t block = 0; block < blocks(); ++block) {
      addTriangle(sums_[block * frames + f].data(), at, size, H, equations.system.b);
    }
  }
  H.triangularView<Eigen::StrictlyLower>() = H.transpose();
  equations.cost = 0;
  for (std::size_t i = 0; i < problem_.known.size(); ++i) {
    const KnownTerm term = knownTerm(problem_, i, static_cast<double>(inverse_depth_[i]));
    equations.system.depth_hessian[i] += static_cast<float>(term.hessian);
    equations.system.depth_gradient[i] += static_cast<float>(term.gradient);
    equations.energy[i] += static_cast<float>(2 * term.cost);
  }
  for (const float energy : equations.energy) equations.cost += 0.5 * static_cast<double>(energy);
}

}  // namespace dsorb::init_orb

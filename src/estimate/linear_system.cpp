// SPDX-License-Identifier: BSD-3-Clause
#include "estimate/linear_system.h"

#include "base/lanes.h"
#include "base/parallel.h"
#include "base/target_clones.h"

#include <Eigen/Cholesky>

#include <algorithm>
#include <cmath>

namespace dsorb {
namespace {

constexpr std::size_t kRows = 8;  // of the reduced system, summed at a time

constexpr std::size_t kWidth = sizeof(DoubleLanes) / sizeof(double);

/// Some points of a system.
template <typename Scalar>
struct PointBlock {
  const Scalar* coupling;  // c, one row a point
  std::size_t stride;      // of a row, a multiple of kRows
  const double* inverse;   // 1 / h
  const Scalar* gradient;  // b
  std::size_t count;
};

/// Sum of c c^T / h, row-major, of each row the blocks of kRows from its diagonal on, then that of
/// c b / h. One tile of the matrix at a time stays in registers.
template <typename Scalar>
DSORB_ALWAYS_INLINE void sumBlock(const PointBlock<Scalar>& block, double* matrix) {
  constexpr std::size_t kParts = kRows / kWidth;
  constexpr std::size_t kPoints = DepthElimination<Scalar>::kBlock;
  const std::size_t stride = block.stride;
  double* vector = matrix + stride * stride;
  for (std::size_t row = 0; row < stride; row += kRows) {
    double scaled[kPoints][kRows];
    for (std::size_t part = 0; part < kRows; part += kWidth) {
      DoubleLanes sum = {};
      for (std::size_t i = 0; i < block.count; ++i) {
        const DoubleLanes coupling =
            block.inverse[i] * loadDoubles(block.coupling + i * stride + row + part);
        store(coupling, scaled[i] + part);
        sum += coupling * static_cast<double>(block.gradient[i]);
      }
      store(sum, vector + row + part);
    }
    for (std::size_t column = row; column < stride; column += kRows) {
      for (std::size_t first = 0; first < kRows; first += kWidth) {
        DoubleLanes sums[kWidth][kParts] = {};
        for (std::size_t i = 0; i < block.count; ++i) {
          DoubleLanes coupling[kParts];
          for (std::size_t part = 0; part < kParts; ++part) {
            coupling[part] = loadDoubles(block.coupling + i * stride + column + part * kWidth);
          }
          for (std::size_t k = 0; k < kWidth; ++k) {
            for (std::size_t part = 0; part < kParts; ++part) {
              sums[k][part] += scaled[i][first + k] * coupling[part];
            }
          }
        }
        for (std::size_t k = 0; k < kWidth; ++k) {
          for (std::size_t part = 0; part < kParts; ++part) {
            store(sums[k][part], matrix + (row + first + k) * stride + column + part * kWidth);
          }
        }
      }
    }
  }
}

/// @param step filled up with zeros to the stride
template <typename Scalar>
DSORB_ALWAYS_INLINE void substituteBlock(const PointBlock<Scalar>& block,
                                         const double* step,
                                         double* depth_step) {
  for (std::size_t i = 0; i < block.count; ++i) {
    DoubleLanes sum = {};
    for (std::size_t k = 0; k < block.stride; k += kWidth) {
      sum += loadDoubles(block.coupling + i * block.stride + k) * loadDoubles(step + k);
    }
    depth_step[i] = -block.inverse[i] * (static_cast<double>(block.gradient[i]) + sumLanes(sum));
  }
}

DSORB_TARGET_CLONES void sum(const PointBlock<float>& block, double* matrix) {
  sumBlock(block, matrix);
}
DSORB_TARGET_CLONES void sum(const PointBlock<double>& block, double* matrix) {
  sumBlock(block, matrix);
}
DSORB_TARGET_CLONES void substitute(const PointBlock<float>& block,
                                    const double* step,
                                    double* depth_step) {
  substituteBlock(block, step, depth_step);
}
DSORB_TARGET_CLONES void substitute(const PointBlock<double>& block,
                                    const double* step,
                                    double* depth_step) {
  substituteBlock(block, step, depth_step);
}

/// Calls function(number, block) for all blocks of points.
template <typename Scalar, typename Function>
void forEachBlock(const LinearSystem<Scalar>& system,
                  const std::vector<double>& inverse,
                  std::size_t size,
                  Function&& function) {
  const std::size_t points = system.points();
  forEachRange((points + size - 1) / size, 1, [&](std::size_t begin, std::size_t end) {
    for (std::size_t number = begin; number < end; ++number) {
      const std::size_t first = number * size;
      function(number,
               PointBlock<Scalar>{system.coupling.data() + first * system.stride,
                                  system.stride,
                                  inverse.data() + first,
                                  system.depth_gradient.data() + first,
                                  std::min(size, points - first)});
    }
  });
}

}  // namespace

template <typename Scalar>
void LinearSystem<Scalar>::reset(Eigen::Index size, std::size_t points) {
  if (size != H.rows() || points != this->points()) {
    stride = (static_cast<std::size_t>(size) + kRows - 1) / kRows * kRows;
    coupling.assign(points * stride, 0);
  }
  H.setZero(size, size);
  b.setZero(size);
  depth_hessian.assign(points, 0);
  depth_gradient.assign(points, 0);
}

template <typename Scalar>
void DepthElimination<Scalar>::damp(const LinearSystem<Scalar>& system, double damping) {
  const double factor = 1 + damping;
  inverse_.resize(system.points());
  std::transform(system.depth_hessian.begin(),
                 system.depth_hessian.end(),
                 inverse_.begin(),
                 [factor](Scalar h) { return h > 0 ? 1 / (factor * static_cast<double>(h)) : 0; });
}

template <typename Scalar>
void DepthElimination<Scalar>::eliminate(const LinearSystem<Scalar>& system,
                                         Eigen::MatrixXd& H,
                                         Eigen::VectorXd& b) {
  const std::size_t stride = system.stride;
  const std::size_t blocks = (system.points() + kBlock - 1) / kBlock;
  const std::size_t part = stride * stride + stride;
  partial_.resize(blocks * part);
  forEachBlock(system, inverse_, kBlock, [&](std::size_t number, const PointBlock<Scalar>& block) {
    sum(block, partial_.data() + number * part);
  });
  for (std::size_t block = 0; block < blocks; ++block) {
    const double* matrix = partial_.data() + block * part;
    const double* vector = matrix + stride * stride;
    for (Eigen::Index r = 0; r < H.rows(); ++r) {
      const double* row = matrix + static_cast<std::size_t>(r) * stride;
      for (Eigen::Index c = r; c < H.rows(); ++c) H(c, r) -= row[c];
      b[r] -= vector[r];
    }
  }
}

template <typename Scalar>
void DepthElimination<Scalar>::substituteBack(const LinearSystem<Scalar>& system,
                                              const Eigen::VectorXd& step,
                                              std::vector<double>& depth_step) const {
  std::vector<double> padded(system.stride, 0);
  for (Eigen::Index i = 0; i < step.size(); ++i) {
    padded[static_cast<std::size_t>(i)] = step[i];
  }
  depth_step.resize(system.points());
  forEachBlock(system, inverse_, kBlock, [&](std::size_t number, const PointBlock<Scalar>& block) {
    substitute(block, padded.data(), depth_step.data() + number * kBlock);
  });
}

std::optional<double> DampedSolver::solve(const LinearSystem<double>& system, double damping) {
  const Eigen::VectorXd diagonal = system.H.diagonal();
  reduced_ = system.H;
  reduced_.diagonal() += damping * diagonal;
  right_ = system.b;
  elimination_.damp(system, damping);
  elimination_.eliminate(system, reduced_, right_);
  const Eigen::LLT<Eigen::Ref<Eigen::MatrixXd>, Eigen::Lower> cholesky(reduced_);
  if (cholesky.info() != Eigen::Success) return std::nullopt;
  step_ = -cholesky.solve(right_);
  double decrease = step_.dot(damping * diagonal.cwiseProduct(step_) - system.b);
  elimination_.substituteBack(system, step_, depth_step_);
  for (std::size_t i = 0; i < depth_step_.size(); ++i) {
    decrease += depth_step_[i] *
                (damping * system.depth_hessian[i] * depth_step_[i] - system.depth_gradient[i]);
  }
  return std::isfinite(decrease) ? std::optional(0.5 * decrease) : std::nullopt;
}

template struct LinearSystem<float>;
template struct LinearSystem<double>;
template class DepthElimination<float>;
template class DepthElimination<double>;

}  // namespace dsorb

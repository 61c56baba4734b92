// SPDX-License-Identifier: BSD-3-Clause
#include "io/image_store.h"

#include "dsorb/error.h"

#include "io/image_decoder.h"

#include <fmt/format.h>
#include <zip.h>

#include <algorithm>
#include <string_view>
#include <utility>

namespace dsorb {
namespace {

namespace fs = std::filesystem;

constexpr zip_uint64_t kFirstBlock = 1 << 20;  // of an image that is read [byte]

bool isImage(const fs::path& name) {
  const std::string file = name.filename().string();
  return !file.empty() && file.front() != '.' && hasImageSuffix(name);
}

bool isDigit(char c) {
  return c >= '0' && c <= '9';
}

/// The digits that begin at a position, which moves behind them.
std::string_view takeDigits(std::string_view name, std::size_t& position) {
  const std::size_t begin = position;
  while (position < name.size() && isDigit(name[position])) ++position;
  return name.substr(begin, position - begin);
}

std::string_view withoutLeadingZeros(std::string_view digits) {
  digits.remove_prefix(std::min(digits.find_first_not_of('0'), digits.size()));
  return digits;
}

/// Orders names as people count: 2.png comes before 10.png, and 1.25.png before 1.5.png.
bool countsBefore(const std::string& left, const std::string& right) {
  std::size_t l = 0;
  std::size_t r = 0;
  while (l < left.size() && r < right.size()) {
    if (!isDigit(left[l]) || !isDigit(right[r])) {
      if (left[l] != right[r]) return left[l] < right[r];
      ++l;
      ++r;
      continue;
    }
    const bool fraction = l > 1 && left[l - 1] == '.' && isDigit(left[l - 2]);
    std::string_view a = takeDigits(left, l);
    std::string_view b = takeDigits(right, r);
    if (!fraction) {
      a = withoutLeadingZeros(a);
      b = withoutLeadingZeros(b);
      if (a.size() != b.size()) return a.size() < b.size();
    }
    if (a != b) return a < b;
  }
  if (l < left.size() || r < right.size()) return l == left.size();
  return left < right;  // they differ by leading zeros
}

class ImageFiles : public ImageStore {
 public:
  explicit ImageFiles(std::vector<std::string> names) : ImageStore(std::move(names)) {}
  [[nodiscard]] std::vector<std::uint8_t> read(int index) override { return readFile(name(index)); }
};

struct CloseArchive {
  void operator()(zip_t* archive) const { zip_discard(archive); }
};
struct CloseEntry {
  void operator()(zip_file_t* entry) const { zip_fclose(entry); }
};
using Archive = std::unique_ptr<zip_t, CloseArchive>;

struct ArchiveEntry {
  std::string name;
  zip_uint64_t position;
  zip_uint64_t bytes;
};

class ZippedImages : public ImageStore {
 public:
  ZippedImages(Archive archive, const fs::path& path, std::vector<ArchiveEntry> entries)
      : ImageStore(namesOf(path, entries)),
        archive_(std::move(archive)),
        entries_(std::move(entries)) {}

  [[nodiscard]] std::vector<std::uint8_t> read(int index) override {
    const ArchiveEntry& entry = entries_[static_cast<std::size_t>(index)];
    if (entry.bytes > kMaxImageBytes) {
      throw IoError(
          fmt::format("{}: {} MiB are too many for an image", name(index), entry.bytes >> 20U));
    }
    const std::unique_ptr<zip_file_t, CloseEntry> file(
        zip_fopen_index(archive_.get(), entry.position, 0));
    // By blocks that double: what an entry claims to hold may not be there.
    std::vector<std::uint8_t> bytes;
    for (zip_uint64_t done = 0; file && done < entry.bytes;) {
      bytes.resize(std::min(entry.bytes, std::max(2 * done, kFirstBlock)));
      const zip_int64_t count = zip_fread(file.get(), bytes.data() + done, bytes.size() - done);
      if (count <= 0) break;
      done += static_cast<zip_uint64_t>(count);
      if (done == entry.bytes) return bytes;
    }
    throw IoError(fmt::format("{}: cannot be read from the archive", name(index)));
  }

 private:
  static std::vector<std::string> namesOf(const fs::path& path,
                                          const std::vector<ArchiveEntry>& entries) {
    std::vector<std::string> names;
    names.reserve(entries.size());
    for (const ArchiveEntry& entry : entries) names.push_back((path / entry.name).string());
    return names;
  }

  Archive archive_;
  std::vector<ArchiveEntry> entries_;
};

std::unique_ptr<ImageStore> openArchive(const fs::path& path) {
  int code = 0;
  Archive archive(zip_open(path.c_str(), ZIP_RDONLY, &code));
  if (!archive) throw IoError(fmt::format("{}: no readable zip archive", path.string()));
  std::vector<ArchiveEntry> entries;
  const zip_int64_t count = zip_get_num_entries(archive.get(), 0);
  for (zip_int64_t i = 0; i < count; ++i) {
    zip_stat_t entry;
    const auto position = static_cast<zip_uint64_t>(i);
    if (zip_stat_index(archive.get(), position, 0, &entry) != 0) {
      throw IoError(fmt::format("{}: entry {} cannot be read", path.string(), i));
    }
    if (isImage(entry.name)) entries.push_back({entry.name, position, entry.size});
  }
  std::sort(entries.begin(), entries.end(), [](const ArchiveEntry& l, const ArchiveEntry& r) {
    return countsBefore(l.name, r.name);
  });
  return std::make_unique<ZippedImages>(std::move(archive), path, std::move(entries));
}

fs::directory_iterator contents(const fs::path& folder) {
  std::error_code error;
  fs::directory_iterator entries(folder, error);
  if (error) {
    throw IoError(fmt::format("{}: cannot be opened: {}", folder.string(), error.message()));
  }
  return entries;
}

std::unique_ptr<ImageStore> openFolder(const fs::path& folder) {
  std::vector<std::string> names;
  for (const fs::directory_entry& entry : contents(folder)) {
    if (isImage(entry.path()) && entry.is_regular_file()) names.push_back(entry.path().string());
  }
  std::sort(names.begin(), names.end(), countsBefore);
  return std::make_unique<ImageFiles>(std::move(names));
}

}  // namespace

std::optional<SourceImage> ImageStore::image(int index) {
  return SourceImage{index, decodeGrey(read(index), name(index)), std::nullopt, {}};
}

std::unique_ptr<ImageStore> openImageList(const std::vector<fs::path>& files) {
  std::vector<std::string> names;
  names.reserve(files.size());
  for (const fs::path& file : files) names.push_back(file.string());
  return std::make_unique<ImageFiles>(std::move(names));
}

std::unique_ptr<ImageStore> openImageStore(const fs::path& path) {
  auto images = fs::is_directory(path) ? openFolder(path) : openArchive(path);
  if (images->size() == 0) throw IoError(fmt::format("{}: holds no images", path.string()));
  return images;
}

bool holdsImages(const fs::path& folder) {
  const auto entries = contents(folder);
  return std::any_of(begin(entries), end(entries), [](const fs::directory_entry& entry) {
    return isImage(entry.path()) && entry.is_regular_file();
  });
}

}  // namespace dsorb

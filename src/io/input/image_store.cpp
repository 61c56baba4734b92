// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/error.h"

#include "io/input/image_decoder.h"
#include "io/input/image_source.h"
#include "io/text_file.h"

#include <zip.h>

#include <algorithm>
#include <map>
#include <string>
#include <utility>

namespace dsorb {
namespace {

namespace fs = std::filesystem;

bool isImage(const fs::path& name) {
  const std::string file = name.filename().string();
  return !file.empty() && file.front() != '.' && hasImageSuffix(name);
}

/// Whether a file would be read if it lay beside the images.
bool isBesideImages(const fs::path& name) {
  const std::string file = name.filename().string();
  return file == "camera.txt" || file == "times.txt" || file == "pcalib.txt";
}

bool isDigit(char c) {
  return c >= '0' && c <= '9';
}

/// What orders names as people count: 2.png comes before 10.png, and 1.25.png before 1.5.png. A
/// number has its length before it, without leading zeros; a fraction is as it stands. The suffix
/// does not count: image.png comes before "image 2.png".
std::string orderOf(const std::string& file) {
  const std::string name = file.substr(0, file.rfind('.'));
  std::string order;
  for (std::size_t i = 0; i < name.size();) {
    const std::size_t begin = i;
    while (i < name.size() && isDigit(name[i])) ++i;
    const bool fraction = begin > 1 && name[begin - 1] == '.' && isDigit(name[begin - 2]);
    std::string digits = name.substr(begin, i - begin);
    if (i > begin && !fraction) {
      digits.erase(0, digits.find_first_not_of('0'));
      order += {'0', static_cast<char>(digits.size())};
    }
    order += digits;
    if (i < name.size()) order += name[i++];
  }
  return order;
}

bool isNumbered(const fs::path& name) {
  const std::string stem = name.stem().string();
  return std::any_of(stem.begin(), stem.end(), isDigit);
}

/// Whether an image without a number begins those that have one: `image.png`, `image 2.png`.
bool begins(const fs::path& name, const std::vector<std::string>& others) {
  const std::string stem = name.stem().string();
  return std::any_of(others.begin(), others.end(), [&](const fs::path& other) {
    return isNumbered(other) && other.stem().string().compare(0, stem.size(), stem) == 0;
  });
}

/// Takes out what is no image of the sequence: files that have another use, and images without a
/// number among numbered ones (vignette.png, mask.png, cover.jpg). @return them
std::vector<std::string> takeAccessories(const std::vector<fs::path>& others,
                                         std::vector<std::string>& names) {
  const bool numbered = std::any_of(
      names.begin(), names.end(), [](const fs::path& name) { return isNumbered(name); });
  const auto is_accessory = [&](const fs::path& file) {
    std::error_code error;
    const bool used = std::any_of(others.begin(), others.end(), [&](const fs::path& other) {
      return other.filename() == file.filename() && fs::equivalent(other, file, error);
    });
    return used || (numbered && !isNumbered(file) && !begins(file, names));
  };
  std::vector<std::string> images;
  std::vector<std::string> accessories;
  for (std::string& name : names) {
    (is_accessory(name) ? accessories : images).push_back(name);
  }
  names = std::move(images);
  return accessories;
}

struct CloseArchive {
  void operator()(zip_t* archive) const {
    if (archive != nullptr) zip_discard(archive);
  }
};
struct CloseEntry {
  void operator()(zip_file_t* entry) const { zip_fclose(entry); }
};

/// The images in the order of their names, without what is none of the sequence.
/// @param left_out files that are left out beside these
std::unique_ptr<ImageStore> inOrder(std::vector<std::string> names,
                                    const std::vector<fs::path>& others,
                                    const std::vector<std::string>& left_out,
                                    ImageStore::Read read) {
  std::vector<std::string> accessories = takeAccessories(others, names);
  accessories.insert(accessories.end(), left_out.begin(), left_out.end());
  std::vector<std::pair<std::string, std::string>> ordered;
  ordered.reserve(names.size());
  for (std::string& name : names) ordered.emplace_back(orderOf(name), std::move(name));
  std::sort(ordered.begin(), ordered.end());
  std::transform(ordered.begin(), ordered.end(), names.begin(), [](auto& name) {
    return std::move(name.second);
  });
  return std::make_unique<ImageStore>(std::move(names), std::move(accessories), std::move(read));
}

/// An image of an archive.
struct ArchiveEntry {
  zip_uint64_t position;
  zip_uint64_t bytes;
};

std::vector<std::uint8_t> readEntry(zip_t* archive,
                                    const ArchiveEntry& entry,
                                    const std::string& name) {
  if (entry.bytes > kMaxImageBytes) {
    throw fileError(name, "{} MiB are too many for an image", entry.bytes >> 20U);
  }
  const std::unique_ptr<zip_file_t, CloseEntry> file(zip_fopen_index(archive, entry.position, 0));
  std::vector<std::uint8_t> bytes(entry.bytes);
  if (file && zip_fread(file.get(), bytes.data(), bytes.size()) == std::int64_t(bytes.size())) {
    return bytes;
  }
  throw fileError(name, "cannot be read from the archive");
}

std::unique_ptr<ImageStore> openArchive(const fs::path& path) {
  int code = 0;
  const std::shared_ptr<zip_t> archive(zip_open(path.c_str(), ZIP_RDONLY, &code), CloseArchive());
  if (!archive) throw fileError(path, "no readable zip archive");
  std::map<std::string, ArchiveEntry> entries;
  std::vector<std::string> names;
  std::vector<std::string> unread;
  const zip_int64_t count = zip_get_num_entries(archive.get(), 0);
  for (zip_int64_t i = 0; i < count; ++i) {
    zip_stat_t entry;
    const auto position = static_cast<zip_uint64_t>(i);
    if (zip_stat_index(archive.get(), position, 0, &entry) != 0) {
      throw fileError(path, "entry {} cannot be read", i);
    }
    const std::string name = (path / entry.name).string();
    if (isImage(name)) {
      if (entries.emplace(name, ArchiveEntry{position, entry.size}).second) names.push_back(name);
    } else if (isBesideImages(name)) {
      unread.push_back(name);
    }
  }
  return inOrder(std::move(names), {}, unread, [archive, entries](const std::string& name) {
    return readEntry(archive.get(), entries.at(name), name);
  });
}

fs::directory_iterator contents(const fs::path& folder) {
  std::error_code error;
  fs::directory_iterator entries(folder, error);
  if (error) throw fileError(folder, "cannot be opened: {}", error.message());
  return entries;
}

std::unique_ptr<ImageStore> openFolder(const fs::path& folder,
                                       const std::vector<fs::path>& others) {
  std::vector<std::string> names;
  for (const fs::directory_entry& entry : contents(folder)) {
    if (isImage(entry.path()) && entry.is_regular_file()) names.push_back(entry.path().string());
  }
  return inOrder(std::move(names), others, {}, readFile);
}

}  // namespace

std::optional<SourceImage> ImageStore::image(int index) {
  return SourceImage{index, decodeGrey(read_(name(index)), name(index)), std::nullopt, {}};
}

std::unique_ptr<ImageStore> openImageList(const std::vector<fs::path>& files) {
  std::vector<std::string> names;
  names.reserve(files.size());
  for (const fs::path& file : files) names.push_back(file.string());
  return std::make_unique<ImageStore>(
      std::move(names), std::vector<std::string>(), ImageStore::Read(readFile));
}

std::unique_ptr<ImageStore> openImageStore(const fs::path& path,
                                           const std::vector<fs::path>& others) {
  auto images = fs::is_directory(path) ? openFolder(path, others) : openArchive(path);
  if (images->size() == 0) throw fileError(path, "holds no images");
  return images;
}

bool holdsImages(const fs::path& folder) {
  const auto entries = contents(folder);
  return std::any_of(begin(entries), end(entries), [](const fs::directory_entry& entry) {
    return isImage(entry.path()) && entry.is_regular_file();
  });
}

}  // namespace dsorb
